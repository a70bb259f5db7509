// Sends events of the buttons of the swatch library panel to the server, and keeps the keyboard focus. On a phone, the
// cards are one row that scrolls sideways: keeps its place, and shows the selected card whole when it changes.
const act = (message) => window.hapscene && window.hapscene.send({ do: "library", ...message });
let last = null;  // focused element of the panel
let row = null, chosen = null, left_px = 0;
document.addEventListener("scroll", (event) => { if (event.target === row) left_px = row.scrollLeft; }, true);
function scrollRow() {
  const now = document.querySelector(".hs-library"), card = now?.querySelector('[aria-pressed="true"]');
  if (!now || now === row) return;
  row = now;
  if (card && card.dataset.name !== chosen) {
    chosen = card.dataset.name;
    const [own, whole] = [card, row].map((node) => node.getBoundingClientRect());
    left_px = own.left - whole.left - (whole.width - own.width) / 2;  // a new row is not scrolled
  }
  row.scrollLeft = left_px;
}
document.addEventListener("click", (event) => {
  const button = event.target.closest && event.target.closest("button[data-library]");
  if (!button) return;
  act({ act: button.dataset.library, name: button.dataset.name });
});
document.addEventListener("focusin", (event) => { last = event.target.dataset && event.target.dataset.library ? event.target : null; });
new MutationObserver(() => {  // the HTML was replaced: restore the focus
  scrollRow();
  if (!last || last.isConnected || document.activeElement !== document.body) return;
  const { library, name } = last.dataset;
  const same = [...document.querySelectorAll("[data-library]")].find((node) => node.dataset.library === library && node.dataset.name === name);
  last = null;
  if (same) same.focus({ preventScroll: true });
}).observe(document.body, { childList: true, subtree: true });
document.addEventListener("keydown", (event) => {  // arrow keys move the focus between cards
  const here = event.target.closest && event.target.closest(".hs-pick");
  const step = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: 3, ArrowUp: -3 }[event.key];
  if (!here || !step) return;
  const cards = [...document.querySelectorAll(".hs-pick")];
  const next = cards[cards.indexOf(here) + step];
  if (next) { event.preventDefault(); event.stopPropagation(); next.focus(); }
}, true);
