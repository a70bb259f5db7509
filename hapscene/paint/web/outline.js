// Draws the outline of the lasso over the canvas, as sent by the server.
export function showOutline(canvas) {
  const ns = "http://www.w3.org/2000/svg", svg = document.createElementNS(ns, "svg");
  const lines = ["hs-outline-under", "hs-outline-over"].map((name) => {
    const line = document.createElementNS(ns, "polyline");
    line.setAttribute("class", name);
    svg.append(line);
    return line;
  });
  svg.id = "hs-outline";
  document.body.append(svg);
  return (corners = []) => {
    const c = canvas();
    svg.style.display = corners.length && c ? "block" : "none";
    if (!corners.length || !c) return;
    const box = c.getBoundingClientRect(), text = [...corners, corners[0]]
      .map(([x, y]) => `${box.left + x * box.width},${box.top + y * box.height}`).join(" ");
    for (const line of lines) line.setAttribute("points", text);
  };
}
