// The tree of bodies in viser's panel: its buttons and fields are HTML of ours; what is done with them is told here.
const tell = (act, node, value) => window.hapscene.send({ do: "body", act, body: node.dataset.body || "", value });
let last = "";
let typed = null;  // what is being typed: a field that is made anew meanwhile goes on with it
document.addEventListener("click", (event) => {
  const node = event.target.closest && event.target.closest("button[data-body-act]");
  if (node) { last = name(node); tell(node.dataset.bodyAct, node, node.value); }
});
document.addEventListener("input", ({ target: node }) => {
  if (node.tagName === "INPUT" && node.dataset.bodySet) typed = { node, field: name(node), value: node.value };
});
const set = ({ target: node }) => {
  if (!node.dataset || !node.dataset.bodySet || (node.dataset.bodySet === "shape" && !node.value)) return;
  last = name(node);
  typed = null;
  tell(node.dataset.bodySet, node, node.value);
  if (node.dataset.bodySet === "shape") node.value = "";
};
document.addEventListener("change", set);
document.addEventListener("focusout", (event) => { if (typed && typed.node === event.target && typed.node.isConnected) set(event); });
document.addEventListener("keydown", (event) => {
  const node = event.target;
  if (!node.dataset || !node.dataset.bodySet || node.tagName !== "INPUT") return;
  if (event.key === "Escape") { typed = null; node.value = node.defaultValue; node.blur(); }
  if (event.key === "Enter") node.blur();
}, true);
const name = ({ dataset }) => `[data-body-${dataset.bodyAct ? "act" : "set"}="${dataset.bodyAct || dataset.bodySet}"]`;
new MutationObserver(() => {  // made anew: the keyboard stays where it was
  if (typed && !typed.node.isConnected) {
    const fields = [...document.querySelectorAll(`.hs-bodies input${typed.field}`)];
    const again = fields.find((node) => node.dataset.body === typed.node.dataset.body);
    if (again) { again.value = typed.value; again.focus({ preventScroll: true }); }
    typed = again ? { ...typed, node: again } : null;
  }
  if (!last || document.activeElement !== document.body) return;
  const found = [...document.querySelectorAll(`.hs-bodies ${last}`)];
  const again = found.find((node) => node.closest('[aria-selected="true"]')) || (found.length === 1 && found[0]);
  last = "";
  if (again) again.focus({ preventScroll: true });
}).observe(document.body, { childList: true, subtree: true });
