// A number with its unit and bounds: a slider and a field that say the same.
import { h, newId } from "../ui/dom.ts";

export interface SliderOptions {
  label: string;
  unit?: string;
  min: number;
  max: number;
  value: number;
  step?: number;
  hint?: string;
  /** What was set stays until `release`, also while the run says otherwise. */
  stays?: boolean;
  /** While it is dragged. */
  input?: (value: number) => void;
  /** When it was set. */
  change?: (value: number) => void;
}

export class Slider {
  readonly element: HTMLElement;
  readonly range: HTMLInputElement;
  readonly number: HTMLInputElement;
  private touched = false;

  constructor(private readonly options: SliderOptions) {
    const { min, max, value, label, unit } = options;
    const step = options.step ?? stepFor(max - min);
    const id = newId("slider");
    const name = unit ? `${label} [${unit}]` : label;
    const shared = { min, max, step, value: rounded(value, step) };
    this.range = h("input", { type: "range", id, title: options.hint, ...shared });
    this.number = h("input", { type: "number", "aria-label": `${name}, number`, ...shared, step: "any" });
    this.range.addEventListener("input", () => {
      this.touched = true;
      this.number.value = this.range.value;
      options.input?.(this.value);
    });
    this.range.addEventListener("change", () => this.set(this.value));
    this.number.addEventListener("change", () => this.set(Number(this.number.value)));
    for (const input of [this.range, this.number])
      input.addEventListener("blur", () => (this.touched &&= options.stays ?? false));
    this.element = h(
      "div",
      { class: "field" },
      h("label", { for: id, title: options.hint }, name),
      this.number,
      this.range,
    );
  }

  get value(): number {
    return Number(this.range.value);
  }

  /** It follows the run again. */
  release(): void {
    this.touched = false;
  }

  /** Follows the run, but not while the operator has a hand on it. */
  follow(value: number, focused = false): void {
    if (this.touched || (!focused && document.activeElement === this.number)) return;
    const text = String(rounded(value, Number(this.range.step)));
    if (this.number.value === text) return;
    this.range.value = this.number.value = text;
  }

  set disabled(off: boolean) {
    this.range.disabled = this.number.disabled = off;
  }

  private set(value: number): void {
    const bounded = Math.min(this.options.max, Math.max(this.options.min, Number.isFinite(value) ? value : this.value));
    this.range.value = this.number.value = String(bounded);
    this.touched = this.options.stays ?? false;
    this.options.change?.(bounded);
  }
}

/** About a thousandth of the span, as a power of ten. */
export function stepFor(span: number): number {
  if (!(span > 0) || !Number.isFinite(span)) return 0.001;
  return 10 ** Math.floor(Math.log10(span / 500));
}

export function rounded(value: number, step: number): number {
  const digits = Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)));
  return Number(value.toFixed(digits));
}
