// A cell of a notebook: the page in a frame; what it asks goes to the kernel, the answers back.

const PACE = 40;  // ms from one look for answers to the next, while some are awaited

function render({ model, el }) {
  const view = String(crypto.getRandomValues(new Uint32Array(1))[0]);
  const frame = document.createElement("iframe");
  frame.title = "slipctl";
  frame.style.cssText = `width: 100%; height: ${model.get("height")}px; border: 1px solid #8888;`;
  frame.srcdoc = model.get("page");
  const awaited = new Set();
  let looking = false;
  const look = () => {
    if (looking || !awaited.size) return;
    looking = true;
    model.send({ view, look: true });
  };
  const asked = (event) => {
    if (event.source !== frame.contentWindow || typeof event.data?.slipctl !== "string") return;
    awaited.add(JSON.parse(event.data.slipctl).kind);
    model.send({ view, ask: event.data.slipctl });
    look();
  };
  const heard = (said, buffers) => {
    if (said?.view !== view) return;
    looking = false;
    for (const kind of said.ended) awaited.delete(kind);
    const frames = [...buffers].map((b) => (b.buffer ?? b).slice(b.byteOffset ?? 0, (b.byteOffset ?? 0) + b.byteLength));
    if (frames.length) frame.contentWindow?.postMessage({ frames }, "*");
    setTimeout(look, frames.length ? 0 : PACE);
  };
  addEventListener("message", asked);
  model.on("msg:custom", heard);
  el.append(frame);
  return () => {
    removeEventListener("message", asked);
    model.off("msg:custom", heard);
  };
}

export default { render };
