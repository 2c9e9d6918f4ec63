// Tabs according to the ARIA practices: arrow keys move between them, the panel is labeled by its tab.
import { button, h, newId } from "./dom.ts";

export interface Tab {
  title: string;
  panel: HTMLElement;
}

export class Tabs {
  readonly list: HTMLElement;
  private readonly buttons: HTMLButtonElement[] = [];
  private open = -1;

  constructor(
    label: string,
    private readonly tabs: readonly Tab[],
  ) {
    this.list = h("div", { class: "tabs", role: "tablist", "aria-label": label, onkeydown: this.onKey });
    tabs.forEach(({ title, panel }, k) => {
      const [name, id] = [newId("tab"), newId("panel")];
      const tab = button(title, () => this.show(k), { role: "tab", id: name, "aria-controls": id });
      Object.assign(panel, { id, role: "tabpanel", tabIndex: 0 });
      panel.setAttribute("aria-labelledby", name);
      panel.classList.add("tab-panel");
      this.buttons.push(tab);
      this.list.append(tab);
    });
    this.show(0);
  }

  get panels(): HTMLElement[] {
    return this.tabs.map((tab) => tab.panel);
  }

  show(which: number | string): void {
    const k = typeof which === "number" ? which : this.tabs.findIndex((tab) => tab.title === which);
    if (k < 0) return;
    this.open = k;
    this.tabs.forEach(({ panel }, i) => {
      panel.hidden = i !== k;
      this.buttons[i]!.setAttribute("aria-selected", String(i === k));
      this.buttons[i]!.tabIndex = i === k ? 0 : -1;
    });
  }

  setHidden(title: string, hidden: boolean): void {
    const k = this.tabs.findIndex((tab) => tab.title === title);
    if (k >= 0) this.buttons[k]!.hidden = hidden;
  }

  isShown(title: string): boolean {
    return this.tabs[this.open]?.title === title;
  }

  private readonly onKey = (event: KeyboardEvent): void => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    let next = this.open;
    do next = (next + step + this.tabs.length) % this.tabs.length;
    while (this.buttons[next]!.hidden);
    this.show(next);
    this.buttons[this.open]!.focus();
  };
}
