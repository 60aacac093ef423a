"use strict";
// Arrays of the page: unpacked once, then read in place.
const Arrays = (() => {
  const KINDS = { f4: Float32Array, u4: Uint32Array, u2: Uint16Array, i2: Int16Array, u1: Uint8Array, i1: Int8Array };
  const GAP = -32768;
  const TOP = 32767;
  let block = new ArrayBuffer(0);

  function bytes(text) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const letters = atob(text);
    const found = new Uint8Array(letters.length);
    for (let k = 0; k < letters.length; k += 1) found[k] = letters.charCodeAt(k);
    return found;
  }

  async function gunzip(text) {
    const stream = new Blob([bytes(text)]).stream();
    return new Response(stream.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  }

  // Unpacks beside the page's thread where the browser starts a worker of a page from the disk.
  function inflated(id) {
    const text = document.getElementById(id).textContent;
    const code = `${bytes}\n${gunzip}\nonmessage = async ({ data }) => { const found = await gunzip(data); postMessage(found, [found]); };`;
    return new Promise((resolve, reject) => {
      const place = URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
      const worker = new Worker(place);
      worker.onmessage = ({ data }) => { resolve(data); worker.terminate(); URL.revokeObjectURL(place); };
      worker.onerror = reject;
      worker.postMessage(text);
    }).catch(() => gunzip(text));
  }

  async function open(id) {
    block = await inflated(id);
  }

  // The same at once, for a page that is printed before its streams are read.
  const inflatedNow = (id) => Inflate.gzip(bytes(document.getElementById(id).textContent));

  function openNow(id) {
    block = inflatedNow(id).buffer;
  }

  function read(where) {
    const array = new KINDS[where.as](block, where.at, where.n);
    if (where.sum) {
      const found = new Uint32Array(where.n);
      let sum = 0;
      for (let k = 0; k < where.n; k += 1) {
        sum += array[k];
        found[k] = sum;
      }
      return found;
    }
    if (where.step === undefined) return array;
    const found = new Float64Array(where.n);
    for (let k = 0; k < where.n; k += 1) found[k] = array[k] === GAP ? NaN : where.low + (array[k] + TOP) * where.step;
    return found;
  }

  return { inflated, inflatedNow, open, openNow, read };
})();
