// Draws the outline of the lasso over the canvas, as sent by the server.
export function showOutline(canvas, client) {
  const ns = "http://www.w3.org/2000/svg", svg = document.createElementNS(ns, "svg");
  const lines = ["hs-outline-under", "hs-outline-over"].map((name) => {
    const line = document.createElementNS(ns, "polyline");
    line.setAttribute("class", name);
    svg.append(line);
    return line;
  });
  svg.id = "hs-outline";
  document.body.append(svg);
  return (outline) => {
    const mine = outline && outline.client === client(), c = canvas();
    svg.style.display = mine && c ? "block" : "none";
    if (!mine || !c) return;
    const box = c.getBoundingClientRect(), text = [...outline.corners, outline.corners[0]]
      .map(([x, y]) => `${box.left + x * box.width},${box.top + y * box.height}`).join(" ");
    for (const line of lines) line.setAttribute("points", text);
  };
}
