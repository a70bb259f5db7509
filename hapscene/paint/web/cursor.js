// A pointer that is moved by keys, for who has no other: arrows move it, Space held down is its button.
const STEP = 6, LEAP = 30;

export function newCursor({ canvas, begin, move, end }) {
  const node = Object.assign(document.createElement("div"), { id: "hs-cursor", tabIndex: 0 });
  node.setAttribute("role", "application");
  node.setAttribute("aria-label", "Pointer on the scene: arrows move it, Space held down uses the tool, Escape leaves");
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
    take(event) {  // whether a key is its own
      if (document.activeElement !== node) return false;
      if (event.key === "Escape") { down = false; node.blur(); return false; }
      if (event.key === " ") { if (!down) { down = true; begin(place()); } return true; }
      const way = WAYS[event.key];
      if (!way) return false;
      const box = canvas().getBoundingClientRect(), step = event.shiftKey ? LEAP : STEP;
      x = Math.min(Math.max(x + (way[0] * step) / box.width, 0), 1);
      y = Math.min(Math.max(y + (way[1] * step) / box.height, 0), 1);
      move(place());
      return true;
    },
  };
}
