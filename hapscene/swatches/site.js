// Finds swatches of the page by words, each anywhere in what is told of them; without it, all are there.
const find = document.querySelector(".find");
const [input, count] = [find.querySelector("input"), find.querySelector("output")];
const tiles = [...document.querySelectorAll(".tile")].map(tile => [tile, tile.textContent.toLowerCase()]);

function show() {
  const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
  for (const [tile, text] of tiles) tile.hidden = !words.every(word => text.includes(word));
  count.textContent = `${tiles.filter(([tile]) => !tile.hidden).length} of ${tiles.length}`;
}

input.addEventListener("input", show);
find.hidden = false;
show();  // what was typed before is there again when one comes back
if (location.protocol.startsWith("http"))
  document.querySelector(".here").textContent = new URL(".", location.href).href;
