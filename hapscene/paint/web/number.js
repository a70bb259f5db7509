// A number that is typed into one of viser's fields. Those count at every key; so it is written into a field of our own,
// over the other, and sent when it is whole: at Enter, Tab or a click elsewhere. Escape leaves the old one.
const isField = (node) => node instanceof HTMLInputElement && node.inputMode === "decimal";

export function typeNumbers({ send, say, client }) {
  const pad = Object.assign(document.createElement("input"), { id: "hs-number", hidden: true });
  let field = null, slider = "";
  function open(over) {
    field = over;
    slider = field.closest(".mantine-NumberInput-root").previousElementSibling.id;  // viser's name of the control
    const { left, top, width, height } = field.getBoundingClientRect(), { font, padding, letterSpacing } = getComputedStyle(field);
    Object.assign(pad.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px`, font, padding, letterSpacing });
    pad.hidden = false;
    pad.focus();
  }
  function close(count) {
    if (!field) return;
    const typed = pad.value.trim(), old = field.value, value = Number(/,\d{3}(\D|$)/.test(typed) ? NaN : typed.replace(",", "."));  // a thousand, or a part of one?
    field = null;
    pad.hidden = true;
    if (!count || typed === old) return;
    if (typed !== "" && Number.isFinite(value)) send({ do: "number", id: slider, value, client: client() });
    else say(`"${typed}" is no number; it stays ${old}.`, "error");
  }
  window.addEventListener("beforeinput", (event) => {
    const { target, inputType } = event;
    if (!isField(target) || inputType === "insertLineBreak") return;  // Enter, with nothing typed
    event.preventDefault();
    event.stopImmediatePropagation();
    if (inputType.startsWith("history")) return;  // nothing has been typed yet
    let { value, selectionStart: from, selectionEnd: to } = target;
    if (inputType.startsWith("delete") && from === to) {
      const all = /Word|Line/.test(inputType);
      if (inputType.endsWith("Forward")) to = all ? value.length : Math.min(to + 1, value.length);
      else from = all ? 0 : Math.max(from - 1, 0);
    }
    open(target);
    pad.value = value;
    pad.setRangeText(event.data ?? event.dataTransfer?.getData("text") ?? "", from, to, "end");
  }, true);
  pad.addEventListener("keydown", ({ key }) => {
    const from = field;
    if (key === "Enter" || key === "Tab" || key === "Escape") close(key !== "Escape");
    if (key === "Tab") from.focus();  // from there it goes on to the next
  });
  pad.addEventListener("blur", () => close(true));
  window.addEventListener("scroll", ({ target }) => { if (target !== pad) close(false); }, true);  // the field has gone
  document.body.append(pad);
}
