"use strict";
// Search in pages that are opened from a disk, where browsers start no workers: a hidden frame runs the script of the
// search instead. Material for MkDocs takes it as its polyfill of the name "iframe-worker".
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(script) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.srcdoc = "<!doctype html>";
      this.started = new Promise((started) => {
        frame.onload = () => {
          const { contentWindow, contentDocument } = frame;
          contentWindow.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
          const element = contentDocument.createElement("script");
          element.onload = () => started(contentWindow);
          element.src = script;
          contentDocument.head.append(element);
        };
      });
      document.body.append(frame);
    }

    postMessage(data) {
      this.started.then((worker) => worker.dispatchEvent(new MessageEvent("message", { data })));
    }
  };
}
