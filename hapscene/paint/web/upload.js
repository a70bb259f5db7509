// Uploads files that are dropped on the page or selected with a button that has data-upload; one WebSocket per upload.
const PIECE = 1 << 18, BUFFERED_MAX = 1 << 22;  // bytes
const home = () => (localStorage.getItem("hapscene") || location.pathname).replace(/\/*$/, "/");
const overlay = Object.assign(document.createElement("div"), { id: "hs-drop", hidden: true, textContent: "Drop files here" });
const note = Object.assign(document.createElement("div"), { id: "hs-upload", hidden: true });
note.setAttribute("role", "status");

function send(files) {
  if (!files.length) return;
  const whole = files.reduce((sum, file) => sum + file.size, 0);
  const wire = new WebSocket(`${location.origin.replace(/^http/, "ws")}${home()}hapscene-upload`);
  wire.onopen = async () => {
    wire.send(JSON.stringify({ files: files.map(({ name, size }) => ({ name, size })) }));
    let gone = 0;
    for (const file of files) {
      for (let at = 0; at < file.size && wire.readyState === 1; at += PIECE) {
        const piece = await file.slice(at, at + PIECE).arrayBuffer();
        while (wire.bufferedAmount > BUFFERED_MAX && wire.readyState === 1) await new Promise((go) => setTimeout(go, 20));
        if (wire.readyState === 1) wire.send(piece);
        gone += piece.byteLength;
        note.hidden = false;
        note.textContent = `Uploading ${files.length === 1 ? file.name : `${files.length} files`}: ${Math.round((100 * gone) / whole)} %`;
      }
    }
  };
  wire.onclose = () => { note.hidden = true; };
}
function choose(accept) {
  const field = Object.assign(document.createElement("input"), { type: "file", multiple: true, accept });
  field.onchange = () => send([...field.files]);
  field.click();
}
const holds = (event) => event.dataTransfer && [...event.dataTransfer.types].includes("Files");
let depth = 0;
window.addEventListener("dragenter", (event) => { if (holds(event)) { depth += 1; overlay.hidden = false; } });
window.addEventListener("dragleave", (event) => { if (holds(event)) { depth -= 1; overlay.hidden = depth <= 0; } });
window.addEventListener("dragover", (event) => { if (holds(event)) event.preventDefault(); });
window.addEventListener("drop", (event) => {
  if (!holds(event)) return;
  event.preventDefault();
  depth = 0;
  overlay.hidden = true;
  send([...event.dataTransfer.files]);
}, true);
document.addEventListener("click", (event) => {
  const button = event.target.closest && event.target.closest("[data-upload]");
  if (button) choose(button.dataset.upload);
});
document.body.append(overlay, note);
