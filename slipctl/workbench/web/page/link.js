// How the page reaches what answers: a websocket, or the notebook whose cell it stands in.

/** What the page needs of a websocket, over messages to the cell around it. */
class Cell {
  constructor() {
    this.readyState = WebSocket.OPEN;
    this.binaryType = "arraybuffer";
    this.onopen = () => {};
    this.onclose = () => {};
    this.onmessage = (/** @type {{data: ArrayBuffer}} */ _) => {};
    addEventListener("message", (event) => {
      if (event.source !== parent || !Array.isArray(event.data?.frames)) return;
      for (const data of event.data.frames) this.onmessage({ data });
    });
    setTimeout(() => this.onopen());
  }

  /** @param {string} text */
  send(text) {
    parent.postMessage({ slipctl: text }, "*");
  }
}

/** Whether the page stands in a cell of a notebook. */
export function inNotebook() {
  return document.documentElement.dataset.notebook === "yes";
}

/** A line to what answers. @param {string} window_ number of this window @returns {any} */
export function lineTo(window_) {
  return inNotebook() ? new Cell() : new WebSocket(`ws://${location.host}/socket?window=${window_}`);
}
