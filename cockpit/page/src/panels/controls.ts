// Controls that several panels share.
import type { Answer } from "../model/description.ts";
import type { Holding, Motion } from "../safety/holding.ts";
import type { Deflection } from "../teleop/jog.ts";
import type { Vector3 } from "../teleop/vectors.ts";
import { div, h, newId, button, type Attributes, type Child } from "../ui/dom.ts";

export interface SliderOptions {
  label: string;
  unit?: string;
  min: number;
  max: number;
  value: number;
  step?: number;
  hint?: string;
  /** A set value stays until `release`, even if the run reports another one. */
  stays?: boolean;
  /** While being dragged. */
  input?: (value: number) => void;
  /** When it was set. */
  change?: (value: number) => void;
}

/** A number with its unit and bounds: a slider and a field with the same value. */
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
    this.element = div("field", h("label", { for: id, title: options.hint }, name), this.number, this.range);
  }

  get value(): number {
    return Number(this.range.value);
  }

  /** Follows the run again. */
  release(): void {
    this.touched = false;
  }

  /** Follows the run unless the operator is changing it. */
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

export const kHoldHint = "Press it until the arm rests; if you release it earlier, the arm is held.";

/** A button for actions that may move an arm: it sends one request, and is held until the arm rests. */
export function holdButton(
  holding: Holding,
  text: Child | Child[],
  ask: () => Promise<Answer>,
  attributes: Attributes = {},
): HTMLButtonElement {
  const element = button(text, undefined, {
    title: kHoldHint,
    ...attributes,
    class: `hold ${attributes["class"] ?? ""}`.trim(),
  });
  const name = String(attributes["aria-label"] ?? text);
  let asked = false;
  holding.bindButton(element, name, {
    begin: () => void (asked = false),
    // The run has been told that the button is held.
    step: () => {
      if (!asked) void ask().then(({ ok }) => ok || holding.letGo(name));
      asked = true;
      return undefined;
    },
    end: () => {},
  });
  return element;
}

/** A panel is not built again under the finger that holds one of its buttons. */
export const isHeldIn = (panel: HTMLElement): boolean => panel.querySelector("button.held") !== null;

const kMoves: [string, string, Vector3][] = [
  ["▲ up", "Move up", [0, 0, 1]],
  ["↑ away", "Move away", [0, 1, 0]],
  ["▼ down", "Move down", [0, 0, -1]],
  ["← left", "Move left", [-1, 0, 0]],
  ["↓ back", "Move back", [0, -1, 0]],
  ["right →", "Move right", [1, 0, 0]],
];

const kTurns: [string, string, Vector3][] = [
  ["⟲ turn", "Turn left", [0, 0, 1]],
  ["pitch ↑", "Pitch up", [1, 0, 0]],
  ["turn ⟳", "Turn right", [0, 0, -1]],
  ["roll ←", "Roll left", [0, -1, 0]],
  ["pitch ↓", "Pitch down", [-1, 0, 0]],
  ["roll →", "Roll right", [0, 1, 0]],
];

/** Twelve buttons that move a hand while they are held: six ways along the axes, six turns about them. */
export function jogPad(holding: Holding, motion: (deflection: () => Deflection) => Motion): HTMLElement {
  const grid = (name: string, buttons: typeof kMoves, deflection: (way: Vector3) => Deflection) =>
    h(
      "div",
      { class: "jog-grid", role: "group", "aria-label": name },
      ...buttons.map(([text, label, way]) => {
        const element = button(text, undefined, { class: "hold", "aria-label": `${label} while held` });
        const led = motion(() => deflection(way));
        holding.bindButton(element, label, led);
        return element;
      }),
    );
  return div(
    "jog",
    grid("Move the hand", kMoves, (linear) => ({ linear, angular: [0, 0, 0] })),
    grid("Turn the hand", kTurns, (angular) => ({ linear: [0, 0, 0], angular })),
  );
}
