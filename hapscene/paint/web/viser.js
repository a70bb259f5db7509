// Fixes of viser's page: accessible names and roles, notifications, tooltips, and elements that are not for users.
const SHEET = '.mantine-Paper-root[style*="position: fixed"]';  // viser's panel in a narrow window
const set = (node, key, value) => { if (value && node.getAttribute(key) !== value) node.setAttribute(key, value); };
const name = (node, text) => { if (!node.getAttribute("aria-label")) set(node, "aria-label", text); };
const write = (node, text) => { if (node.textContent !== text) node.textContent = text; };
const asButton = (node, label) => {
  set(node, "aria-label", label);
  if (node.getAttribute("role")) return;
  node.setAttribute("role", "button");
  node.tabIndex = 0;
  node.addEventListener("keydown", (event) => {
    if (event.target === node && (event.key === "Enter" || event.key === " ")) { event.preventDefault(); node.click(); }
  });
};

export function fixPage(say) {
  for (const label of document.querySelectorAll("label[for]")) {  // viser's labels refer to no field
    const row = label.closest(".mantine-Text-root")?.parentElement?.parentElement;
    if (!row) continue;
    const fields = row.querySelectorAll("[role=slider], input, textarea, button"), many = row.querySelectorAll("input").length > 2;
    fields.forEach((field, i) => field.matches("button:not(:has(svg))") || name(field, many ? `${label.textContent} ${"xyzw"[i] ?? i + 1}` : label.textContent));
  }
  for (const arrow of document.querySelectorAll(".mantine-Paper-root > .mantine-Paper-root > svg")) {
    const head = arrow.parentElement;  // header of a folder
    asButton(head, `${head.textContent}: expand or collapse`);
    set(head, "aria-expanded", String(arrow.classList.contains("tabler-icon-chevron-up")));
  }
  const sheet = document.querySelector(SHEET);
  const handle = sheet?.querySelector('[style*="cursor: pointer"]');
  if (handle) asButton(handle, `${handle.textContent}: show or hide the panel`);
  const panel = sheet ?? document.querySelector("[role=tablist]")?.closest(".mantine-Paper-root");
  if (panel && !panel.getAttribute("role")) { panel.setAttribute("role", "region"); name(panel, "Panel"); }
  for (const canvas of document.querySelectorAll("#root canvas")) {
    if (canvas.dataset.engine) { canvas.setAttribute("role", "img"); name(canvas, "Scene"); } else canvas.setAttribute("aria-hidden", "true");
  }
  for (const node of document.querySelectorAll("#root [title]")) {
    if (node.title !== node.textContent) node.dataset.tip = node.title;  // native tooltips would cover controls
    node.removeAttribute("title");
  }
  for (const choice of document.querySelectorAll(".mantine-Switch-root"))  // turns off viser's crosshair
    if (choice.textContent === "Show Orbit Crosshair" && choice.querySelector("input").checked) choice.querySelector("input").click();
  for (const note of document.querySelectorAll(".mantine-Notification-root:not([data-shown])")) {
    note.dataset.shown = "";  // viser's notifications are hidden by page.css and shown as messages instead
    if (!note.textContent.startsWith("Software WebGL")) say(note.textContent, "error");
  }
}

let last_px = 0;
export function sheetHeight() {  // [px]; also sets a CSS variable
  const sheet_px = document.querySelector(SHEET)?.getBoundingClientRect().height ?? 0;
  if (sheet_px !== last_px) document.documentElement.style.setProperty("--sheet", `${sheet_px}px`);
  return (last_px = sheet_px);
}

// Shows tooltips in the status line, where they cover nothing: hints of buttons, and viser's own tooltips.
export function showTips(line, hints) {
  const update = (event) => {
    const node = event.target.closest?.("[data-tip], button") ?? event.target;
    const hint = node.dataset?.tip ?? hints()[node.id] ?? "";
    if (hint && node.id) node.setAttribute("aria-description", hint);
    write(line, hint);
  };
  window.addEventListener("pointerover", update, true);
  window.addEventListener("focusin", update, true);
  let shown = null;
  return () => {
    const over = document.querySelector(".mantine-Tooltip-tooltip");
    if (over !== shown) write(line, over?.textContent ?? "");
    shown = over;
  };
}
