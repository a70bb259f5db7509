// The shelf's cards are HTML of our own in viser's panel: their buttons and choices speak to the server here.
const act = (message) => window.hapscene && window.hapscene.send({ do: "shelf", ...message });
let last = null;
document.addEventListener("click", (event) => {
  const button = event.target.closest && event.target.closest("button[data-shelf]");
  if (!button) return;
  act({ act: button.dataset.shelf, name: button.dataset.name });
});
document.addEventListener("change", (event) => {
  if (event.target.matches && event.target.matches("select[data-shelf]")) act({ act: event.target.dataset.shelf, value: event.target.value });
});
document.addEventListener("focusin", (event) => { last = event.target.dataset && event.target.dataset.shelf ? event.target : null; });
new MutationObserver(() => {  // a card that was drawn anew while it had the keyboard has it again
  if (!last || last.isConnected || document.activeElement !== document.body) return;
  const { shelf, name } = last.dataset;
  const same = [...document.querySelectorAll("[data-shelf]")].find((node) => node.dataset.shelf === shelf && node.dataset.name === name);
  last = null;
  if (same) same.focus({ preventScroll: true });
}).observe(document.body, { childList: true, subtree: true });
document.addEventListener("keydown", (event) => {  // arrows go from card to card
  const here = event.target.closest && event.target.closest(".hs-pick");
  const step = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: 3, ArrowUp: -3 }[event.key];
  if (!here || !step) return;
  const cards = [...document.querySelectorAll(".hs-pick")];
  const next = cards[cards.indexOf(here) + step];
  if (next) { event.preventDefault(); event.stopPropagation(); next.focus(); }
}, true);
