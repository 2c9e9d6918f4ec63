// Short messages: what was refused, and why. Screen readers read them out.
import { button, h, icon } from "./dom.ts";

const kStay = 12_000; // [ms]
const kMost = 4;

export class Toasts {
  readonly element = h("div", { class: "toasts", role: "log", "aria-label": "Messages", "aria-live": "polite" });

  show(text: string): void {
    const toast = h("div", { class: "toast" }, h("p", {}, text));
    toast.append(
      button(icon("close", 12), () => toast.remove(), { class: "quiet icon-only", "aria-label": "Dismiss" }),
    );
    for (const old of [...this.element.children]) if (old.firstChild?.textContent === text) old.remove();
    this.element.append(toast);
    while (this.element.children.length > kMost) this.element.firstElementChild!.remove();
    setTimeout(() => toast.remove(), kStay);
  }
}
