// Plots chosen by the operator, side by side.
import type { History } from "../model/history.ts";
import { h, newId, replaceChildren } from "../ui/dom.ts";
import type { ThemeSwitch } from "../ui/theme.ts";
import { Plot } from "./plot.ts";

export interface Quantity {
  name: string;
  size: number;
}

const kMostPlots = 6;

export class PlotsPanel {
  readonly element: HTMLElement;
  /** Length of the displayed past [s]. */
  seconds = 10;
  private readonly plots: Plot[] = [];
  private readonly row = h("div", { class: "plots" });
  private readonly names = h("datalist", { id: newId("quantities") });
  private readonly field = h("input", {
    type: "text",
    list: this.names.id,
    placeholder: "Quantity, for example left/q_rad",
    "aria-label": "Quantity to plot",
    autocomplete: "off",
  });
  private quantities = new Map<string, number>();
  private drawn = 0;

  constructor(
    private readonly history: History,
    private readonly theme: ThemeSwitch,
    private readonly watched: (names: string[]) => void,
    private readonly refuse: (why: string) => void,
  ) {
    const submit = h("button", { type: "submit" }, "Add plot");
    const form = h("form", { class: "row", "aria-label": "Add a plot" }, this.field, this.names, submit);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.add(this.field.value.trim());
      this.field.value = "";
    });
    this.element = h("div", { class: "plots-panel" }, form, this.row);
  }

  offer(quantities: readonly Quantity[]): void {
    this.quantities = new Map(quantities.map(({ name, size }) => [name, size]));
    replaceChildren(this.names, ...quantities.map(({ name }) => h("option", { value: name })));
  }

  add(name: string): void {
    const size = this.quantities.get(name);
    if (size === undefined) return this.refuse(`There is no quantity '${name}'. The field lists all of them.`);
    if (this.plots.length >= kMostPlots) return this.refuse(`There are ${kMostPlots} plots already. Remove one first.`);
    this.history.watch(name, size);
    const source = {
      name,
      components: componentNames(name, size),
      columns: () => this.history.columns(name, this.seconds),
      dispose: () => this.history.unwatch(name),
    };
    const plot = new Plot(source, this.theme, (gone) => this.remove(gone));
    this.plots.push(plot);
    this.row.append(plot.element);
    this.watched(this.history.names());
  }

  update(): void {
    const now = performance.now();
    if (now - this.drawn < 66 || this.element.clientWidth === 0) return;
    this.drawn = now;
    for (const plot of this.plots) plot.update();
  }

  private remove(plot: Plot): void {
    this.plots.splice(this.plots.indexOf(plot), 1);
    plot.dispose();
    plot.element.remove();
    this.watched(this.history.names());
  }
}

/** Names of a quantity's numbers. */
export function componentNames(name: string, size: number): string[] {
  if (size === 1) return [name.slice(name.lastIndexOf("/") + 1)];
  if (name.endsWith("position_m") && size === 3) return ["x", "y", "z"];
  if (name.endsWith("quaternion_wxyz")) return ["w", "x", "y", "z"];
  if (name.includes("wrench") && size === 6) return ["fx", "fy", "fz", "mx", "my", "mz"];
  if (/pose$/.test(name) && size === 7) return ["x", "y", "z", "qw", "qx", "qy", "qz"];
  return Array.from({ length: size }, (_, k) => String(k + 1));
}
