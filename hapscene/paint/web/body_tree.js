// Sends events of the buttons and fields in the tab Bodies to the server. The server replaces the HTML after each change,
// so this script restores the keyboard focus and text that is being typed.
const sendAction = (act, node, value) => window.hapscene.send({ do: "body", act, body: node.dataset.body || "", value });
let last = "";  // selector of the element used last
let typed = null;  // field that is being edited: { node, field, value }
document.addEventListener("click", (event) => {
  const node = event.target.closest && event.target.closest("button[data-body-act]");
  if (node) { last = selector(node); sendAction(node.dataset.bodyAct, node, node.value); }
});
document.addEventListener("input", ({ target: node }) => {
  if (node.tagName === "INPUT" && node.dataset.bodySet) typed = { node, field: selector(node), value: node.value };
});
const submit = ({ target: node }) => {
  if (!node.dataset || !node.dataset.bodySet) return;
  last = selector(node);
  typed = null;
  sendAction(node.dataset.bodySet, node, node.value);
};
document.addEventListener("change", submit);
document.addEventListener("focusout", (event) => { if (typed && typed.node === event.target && typed.node.isConnected) submit(event); });
document.addEventListener("keydown", (event) => {
  const node = event.target;
  if (!node.dataset || !node.dataset.bodySet || node.tagName !== "INPUT") return;
  if (event.key === "Escape") { typed = null; node.value = node.defaultValue; node.blur(); }
  if (event.key === "Enter") node.blur();
}, true);
const selector = ({ dataset }) => `[data-body-${dataset.bodyAct ? "act" : "set"}="${dataset.bodyAct || dataset.bodySet}"]`;
new MutationObserver(() => {  // the HTML was replaced: restore text and focus
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
