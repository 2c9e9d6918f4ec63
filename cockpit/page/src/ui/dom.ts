// Elements in one expression, and nothing more: the page is small enough for the browser's own interfaces.

export type Child = Node | string | number | null | undefined | false;
type Handler = (event: never) => void;
export type Attributes = Record<string, string | number | boolean | null | undefined | Handler>;

/** An element: `h("button", { type: "button", class: "primary", onclick: go }, "Go")`. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  setAttributes(element, attributes);
  append(element, children);
  return element;
}

/** The same for drawings. */
export function svg(tag: string, attributes: Attributes = {}, ...children: Child[]): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  setAttributes(element, attributes);
  append(element, children);
  return element;
}

function setAttributes(element: Element, attributes: Attributes): void {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (typeof value === "function") element.addEventListener(name.replace(/^on/, ""), value as EventListener);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
}

function append(element: Element, children: Child[]): void {
  for (const child of children) {
    if (child === undefined || child === null || child === false) continue;
    element.append(typeof child === "number" ? String(child) : child);
  }
}

type Text = Child | Child[];

/** A button: label and action; attributes set style and name. */
export function button(text: Text, act: (() => void) | undefined, attributes: Attributes = {}): HTMLButtonElement {
  const children = Array.isArray(text) ? text : [text];
  return h("button", { type: "button", ...(act && { onclick: () => act() }), ...attributes }, ...children);
}

/** A box to check, with its label. */
export function check(text: Text, set: (on: boolean) => void, box: Attributes = {}): HTMLElement {
  const input = h("input", { type: "checkbox", ...box, onchange: () => set(input.checked) });
  return h("label", { class: "check" }, input, ...(Array.isArray(text) ? text : [text]));
}

/** A drop-down list: values, or values with labels. */
export function choice(
  options: readonly (string | readonly [string, string])[],
  current: string,
  set: (value: string) => void,
  attributes: Attributes = {},
): HTMLSelectElement {
  const select = h("select", { ...attributes, onchange: () => set(select.value) });
  for (const option of options) {
    const [value, text] = typeof option === "string" ? [option, option] : option;
    select.append(h("option", { value }, text));
  }
  select.value = current;
  return select;
}

export const div = (name: string, ...children: Child[]): HTMLElement =>
  h("div", name ? { class: name } : {}, ...children);
export const row = (...children: Child[]): HTMLElement => div("row", ...children);
export const section = (title: string, ...children: Child[]): HTMLElement =>
  div("section", h("h2", {}, title), ...children);
export const fold = (title: string, ...children: Child[]): HTMLElement =>
  h("details", {}, h("summary", {}, title), ...children);

export function replaceChildren(element: Element, ...children: Child[]): void {
  element.replaceChildren();
  append(element, children);
}

/** Sets a text only if it differs, to avoid layout and screen-reader output. */
export function setText(element: Node, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

export function setAttribute(element: Element, name: string, value: string): void {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

export function toggle(element: Element, name: string, on: boolean): void {
  if (element.classList.contains(name) !== on) element.classList.toggle(name, on);
}

let lastId = 0;
/** A unique id in the page, to connect labels to fields. */
export const newId = (stem: string): string => `${stem}-${++lastId}`;

/** Passes a file to the browser's downloads. */
export function download(name: string, content: Blob | string): void {
  const url = typeof content === "string" ? content : URL.createObjectURL(content);
  const link = h("a", { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  if (typeof content !== "string") setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

export const textFile = (text: string, type: string): Blob => new Blob([text], { type });

// Line drawings of 24 by 24, as paths.
const paths = {
  stop: "M8 2h8l6 6v8l-6 6H8l-6-6V8z",
  play: "M7 4l13 8-13 8z",
  pause: "M7 4h3v16H7zM14 4h3v16h-3z",
  step: "M5 4l10 8-10 8zM17 4h3v16h-3z",
  reset: "M4 12a8 8 0 1 0 2.6-5.9M4 3v5h5",
  sun: "M12 7a5 5 0 1 0 0 10 5 5 0 0 0 0-10zM12 1v3M12 20v3M1 12h3M20 12h3M4 4l2 2M18 18l2 2M20 4l-2 2M4 20l2-2",
  moon: "M20 14.5A8.5 8.5 0 0 1 9.5 4a8.5 8.5 0 1 0 10.5 10.5z",
  warning: "M12 3L1.5 21h21zM12 10v5M12 17.5v.5",
  camera: "M3 7h4l2-3h6l2 3h4v13H3zM12 9a4 4 0 1 0 0 8 4 4 0 0 0 0-8z",
  close: "M5 5l14 14M19 5L5 19",
  gamepad:
    "M7 7h10a5 5 0 0 1 4.9 6l-.7 3.5a2.5 2.5 0 0 1-4.4 1.2L15 15H9l-1.8 2.7a2.5 2.5 0 0 1-4.4-1.2L2.1 13A5 5 0 0 1 7 7zM8 9.5v3M6.5 11h3M16 10.5v.1M18 12.5v.1",
  mouse: "M12 3a6 6 0 0 1 6 6v6a6 6 0 0 1-12 0V9a6 6 0 0 1 6-6zM12 3v7",
  headset: "M3 8h18v9h-6l-2-3h-2l-2 3H3z",
  keyboard: "M2 6h20v12H2zM6 10h.1M10 10h.1M14 10h.1M18 10h.1M7 14h10",
} as const;

export type IconName = keyof typeof paths;

export function icon(name: IconName, size = 16): SVGElement {
  return svg(
    "svg",
    { class: "icon", viewBox: "0 0 24 24", width: size, height: size, "aria-hidden": "true", focusable: "false" },
    svg("path", { d: paths[name] }),
  );
}
