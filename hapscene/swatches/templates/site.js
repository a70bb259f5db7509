// Search: shows the swatches whose text contains all words. Without this script all swatches are visible.
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
show();  // browsers restore the input when the user navigates back
if (location.protocol.startsWith("http"))
  document.querySelector(".here").textContent = new URL(".", location.href).href;
