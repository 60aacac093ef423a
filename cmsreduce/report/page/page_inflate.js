"use strict";
// Gzip without a stream (RFC 1951, 1952): a browser that prints a page at once does not wait for streams.
const Inflate = (() => {
  const LENGTHS = [3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163, 195, 227, 258];
  const MORE = [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0];
  const BACK = Array.from({ length: 30 }, (_, k) => (k < 4 ? k + 1 : (2 + (k & 1)) * 2 ** ((k >> 1) - 1) + 1));
  const ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
  const LONGEST = 15;

  // Table over the next 15 bits: symbol times 16, plus the bits of its code.
  function tree(bits) {
    const table = new Uint16Array(1 << LONGEST);
    let code = 0;
    for (let size = 1; size <= LONGEST; size += 1) {
      for (let symbol = 0; symbol < bits.length; symbol += 1) {
        if (bits[symbol] !== size) continue;
        let turned = 0;
        for (let bit = 0; bit < size; bit += 1) turned |= ((code >> bit) & 1) << (size - 1 - bit);
        for (let at = turned; at < table.length; at += 1 << size) table[at] = symbol * 16 + size;
        code += 1;
      }
      code <<= 1;
    }
    return table;
  }

  function gzip(data) {
    // The page's own files: a header of ten bytes without a name, and their size at the end.
    const out = new Uint8Array(new DataView(data.buffer, data.byteOffset).getUint32(data.length - 4, true));
    let [at, held, count, to] = [10, 0, 0, 0];
    function bits(many) {
      while (count < many) {
        held |= data[at] << count;
        at += 1;
        count += 8;
      }
      const value = held & ((1 << many) - 1);
      held >>>= many;
      count -= many;
      return value;
    }
    function symbol(table) {
      while (count < LONGEST) {
        held |= (at < data.length ? data[at] : 0) << count;
        at += 1;
        count += 8;
      }
      const found = table[held & 0x7fff];
      held >>>= found & 15;
      count -= found & 15;
      return found >> 4;
    }
    for (let last = 0; !last;) {
      last = bits(1);
      const kind = bits(2);
      if (kind === 0) {
        at -= count >> 3;
        [held, count] = [0, 0];
        const size = data[at] | (data[at + 1] << 8);
        out.set(data.subarray(at + 4, at + 4 + size), to);
        at += 4 + size;
        to += size;
        continue;
      }
      let lengths = Array.from({ length: 288 }, (_, k) => (k < 144 ? 8 : k < 256 ? 9 : k < 280 ? 7 : 8));
      let backs = new Array(30).fill(5);
      if (kind === 2) {
        const [literals, distances, codes] = [bits(5) + 257, bits(5) + 1, bits(4) + 4];
        const sizes = new Array(19).fill(0);
        for (let k = 0; k < codes; k += 1) sizes[ORDER[k]] = bits(3);
        const table = tree(sizes);
        const found = [];
        while (found.length < literals + distances) {
          const next = symbol(table);
          if (next < 16) found.push(next);
          else {
            const value = next === 16 ? found[found.length - 1] : 0;
            const times = next === 16 ? 3 + bits(2) : next === 17 ? 3 + bits(3) : 11 + bits(7);
            for (let k = 0; k < times; k += 1) found.push(value);
          }
        }
        [lengths, backs] = [found.slice(0, literals), found.slice(literals)];
      }
      const [letters, distances] = [tree(lengths), tree(backs)];
      for (let next = symbol(letters); next !== 256; next = symbol(letters)) {
        if (next < 256) {
          out[to] = next;
          to += 1;
        } else {
          const length = LENGTHS[next - 257] + bits(MORE[next - 257]);
          const code = symbol(distances);
          const from = to - BACK[code] - bits(code < 4 ? 0 : (code >> 1) - 1);
          for (let k = 0; k < length; k += 1) out[to + k] = out[from + k];
          to += length;
        }
      }
    }
    return out;
  }

  return { gzip };
})();
