// The keys of the page, and the dialog that lists them.
const KEYS = [
  ["Tools", [
    ["1 … 9", "brush, fill, box, sphere, eraser, pick, touch, lasso, polygon"],
    ["I", "take the swatch under the pointer"],
    ["Enter, Esc", "close a polygon, or drop it"],
    ["Shift + drag", "use the tool on the surface"],
    ["L", "a plain drag uses the tool, and Shift + drag turns the view"],
    ["[  ]", "smaller, larger brush"],
    ["Esc", "cancel what is being drawn; close a dialog"],
    ["K", "paint by keys: arrows move, with Shift in larger steps; hold Space to use the tool"],
  ]],
  ["View", [
    ["drag, right drag, wheel", "turn, move, zoom"],
    ["F", "frame the chosen body, or the one under the pointer, or all"],
    ["Home", "see all, as at first"],
    ["Shift + 1 … 7", "front, back, left, right, top, bottom, perspective"],
    ["W A S D Q E, arrows", "walk and turn"],
  ]],
  ["Work", [
    ["Ctrl Z, Ctrl Y", "undo, redo"],
    ["Ctrl S", "save"],
    ["P", "show or hide the plots"],
    ["H", "show or hide the hint"],
    ["?", "this list"],
  ]],
];

export function newKeyList(make) {
  const close = make("button", { type: "button", onclick: () => list.close() }, "Close");
  const list = make("dialog", { id: "hs-keys" }, make("h2", { id: "hs-keys-title" }, "Keys"));
  list.setAttribute("aria-labelledby", "hs-keys-title");
  for (const [group, rows] of KEYS) {
    const body = make("tbody", {});
    for (const [keys, what] of rows) body.append(make("tr", {}, make("th", { scope: "row" }, make("kbd", {}, keys)), make("td", {}, what)));
    list.append(make("table", {}, make("caption", {}, group), body));
  }
  list.append(close);
  list.addEventListener("click", (event) => { if (event.target === list) list.close(); });  // beside it
  return list;
}
