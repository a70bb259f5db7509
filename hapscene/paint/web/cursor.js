// Keyboard pointer, for users without a mouse: arrow keys move it, and Space is its button.
const STEP = 6, LARGE_STEP = 30;  // pixels

export function newCursor({ canvas, begin, move, end }) {
  const node = Object.assign(document.createElement("div"), { id: "hs-cursor", tabIndex: 0 });
  node.setAttribute("role", "application");
  node.setAttribute("aria-label", "Keyboard pointer: arrow keys move it, hold Space to use the tool, Escape exits");
  let x = 0.5, y = 0.5, down = false;
  const place = () => {
    const box = canvas().getBoundingClientRect();
    Object.assign(node.style, { left: `${x * box.width}px`, top: `${y * box.height}px` });
    return { clientX: box.left + x * box.width, clientY: box.top + y * box.height };
  };
  const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const lift = () => { if (down) end(place()); down = false; };
  node.addEventListener("focus", () => move(place()));
  node.addEventListener("blur", lift);
  node.addEventListener("keyup", (event) => { if (event.key === " ") lift(); });
  return {
    node, place,
    take(event) {  // handles a key; returns whether the key was used
      if (document.activeElement !== node) return false;
      if (event.key === "Escape") { down = false; node.blur(); return false; }
      if (event.key === " ") { if (!down) { down = true; begin(place()); } return true; }
      const way = WAYS[event.key];
      if (!way) return false;
      const box = canvas().getBoundingClientRect(), step = event.shiftKey ? LARGE_STEP : STEP;
      x = Math.min(Math.max(x + (way[0] * step) / box.width, 0), 1);
      y = Math.min(Math.max(y + (way[1] * step) / box.height, 0), 1);
      move(place());
      return true;
    },
  };
}
