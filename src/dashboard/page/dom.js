// Elements: text goes in as text, never as markup.

const SVG = "http://www.w3.org/2000/svg";

function append(node, children) {
  for (const child of children.flat(Infinity)) {
    if (child === null || child === undefined || child === false) continue;
    node.append(child instanceof Node ? child : String(child));
  }
  return node;
}

function put(node, props, isSvg) {
  for (const [name, value] of Object.entries(props ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "class") node.setAttribute("class", value);
    else if (name === "dataset") Object.assign(node.dataset, value);
    else if (!isSvg && name in node && !name.includes("-") && typeof value !== "string") node[name] = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  return node;
}

/** An element: `h("p", { class: "soft" }, "text", child)`. Properties that are null or false are left out. */
export function h(tag, props, ...children) {
  return append(put(document.createElement(tag), props, false), children);
}

/** An element of SVG. */
export function s(tag, props, ...children) {
  return append(put(document.createElementNS(SVG, tag), props, true), children);
}

/** Puts children in place of what is there. */
export function fill(node, ...children) {
  node.replaceChildren();
  return append(node, children);
}

/** A symbol of the page's own set, hidden from readers of the screen. */
export function icon(name) {
  const paths = {
    healthy: "M8 2.5a5.5 5.5 0 1 1 0 11a5.5 5.5 0 0 1 0-11z",
    warning: "M8 1.8 15 14H1z",
    damaged: "M8 .8 15.2 8 8 15.2.8 8z",
    undetermined: "M8 2.5a5.5 5.5 0 1 1 0 11a5.5 5.5 0 0 1 0-11zm0 2a3.5 3.5 0 1 0 0 7a3.5 3.5 0 0 0 0-7z",
  };
  const path = s("path", { d: paths[name] ?? paths.undetermined, "fill-rule": "evenodd" });
  return s("svg", { class: "icon", viewBox: "0 0 16 16", "aria-hidden": "true" }, path);
}

/** A state in words with its symbol: colour is never the only sign. */
export function badge(state) {
  return h("span", { class: `badge ${state}` }, icon(state), state);
}

/** What a part shows while it waits, when there is nothing, and when asking failed. */
export const loading = (what) => h("p", { class: "note", role: "status" }, `Loading ${what} …`);
export const empty = (...why) => h("p", { class: "note" }, why);
export function failed(error, again) {
  // An error that trying again alone does not mend says what does.
  const { text, prepare } = error.remedy ?? { text: "Try again", prepare() {} };
  const retry = again && h("button", { type: "button", onclick: () => { prepare(); again(); } }, text);
  return h("p", { class: "note failed", role: "alert" }, `${error.message} `, retry);
}

/** A labelled control. */
export function field(label, control, hint) {
  return h("label", { class: "field" }, h("span", null, label), control, hint && h("small", null, hint));
}

export function select(options, chosen, onchange, props) {
  const made = h("select", { ...props, onchange: (event) => onchange(event.target.value) });
  for (const [value, text] of options) made.append(new Option(text, value, false, value === chosen));
  return made;
}

/** Buttons of which one is chosen. */
export function choice(label, options, chosen, onchange) {
  const buttons = options.map(([value, text]) =>
    h("button", { type: "button", "aria-pressed": String(value === chosen), dataset: { value }, onclick: () => onchange(value) }, text),
  );
  return h("div", { class: "choice", role: "group", "aria-label": label }, buttons);
}
