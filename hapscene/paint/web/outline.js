// The line of lasso and polygon over the canvas, as the server tells it.
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
  return (told) => {
    const mine = told && told.client === client(), c = canvas();
    svg.style.display = mine && c ? "block" : "none";
    if (!mine || !c) return;
    const box = c.getBoundingClientRect(), text = [...told.corners, told.corners[0]]
      .map(([x, y]) => `${box.left + x * box.width},${box.top + y * box.height}`).join(" ");
    for (const line of lines) line.setAttribute("points", text);
  };
}
