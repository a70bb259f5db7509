// Dialog with the keyboard shortcuts of the page.
const KEYS = [
  ["Tools", [
    ["1 … 7", "brush, fill, sphere, eraser, pick, touch, lasso"],
    ["Shift + drag", "use the tool on the surface"],
    ["L", "draw: drag to use the tool, Shift + drag to rotate the view"],
    ["[  ]", "decrease, increase the brush size"],
    ["Esc", "cancel the operation; close a dialog"],
    ["K", "keyboard pointer: arrow keys move it (with Shift in larger steps), hold Space to use the tool"],
  ]],
  ["View", [
    ["drag, right drag, wheel", "rotate, pan, zoom"],
    ["F", "frame the selected body, the body under the pointer, or the scene"],
    ["Home", "reset the view"],
    ["V", "show the materials of the mesh files, the paint, or both"],
    ["Shift + 1 … 7", "front, back, left, right, top, bottom, perspective"],
    ["W A S D Q E, arrows", "move and rotate the camera"],
  ]],
  ["General", [
    ["Ctrl Z, Ctrl Y", "undo, redo"],
    ["Ctrl S", "save"],
    ["P", "show or hide the plots"],
    ["H", "show or hide the instructions"],
    ["?", "show the keyboard shortcuts"],
  ]],
];

export function newKeyList(make) {
  const close = make("button", { type: "button", onclick: () => list.close() }, "Close");
  const list = make("dialog", { id: "hs-keys" }, make("h2", { id: "hs-keys-title" }, "Keyboard shortcuts"));
  list.setAttribute("aria-labelledby", "hs-keys-title");
  for (const [group, rows] of KEYS) {
    const body = make("tbody", {});
    for (const [keys, what] of rows) body.append(make("tr", {}, make("th", { scope: "row" }, make("kbd", {}, keys)), make("td", {}, what)));
    list.append(make("table", {}, make("caption", {}, group), body));
  }
  list.append(close);
  list.addEventListener("click", (event) => { if (event.target === list) list.close(); });  // a click outside
  return list;
}
