// Fields for the parameters of a controllet, made from its descriptor: unit, bounds and help come from there.
import type { Answer, ControlletInfo, ParameterInfo } from "../model/description.ts";
import type { Holding } from "../safety/holding.ts";
import { choice, div, h, newId } from "../ui/dom.ts";
import { spaced, withoutUnit } from "../ui/words.ts";
import { holdButton, Slider } from "./controls.ts";

type Value = number | number[] | string;
/** Values chosen but not set yet, by controllet and parameter. */
export type Drafts = Map<string, number[] | string>;

export interface ParameterSetter {
  set(name: string, value: Value): Promise<Answer>;
  holding: Holding;
  drafts: Drafts;
}

export function parameterList(controllet: ControlletInfo, setter: ParameterSetter): HTMLElement {
  const list = h("div", { class: "parameters" });
  for (const parameter of controllet.parameters) list.append(field(controllet.name, parameter, setter));
  if (controllet.parameters.length === 0) list.append(h("p", { class: "hint" }, "It has no parameters."));
  return list;
}

function field(controllet: string, parameter: ParameterInfo, setter: ParameterSetter): HTMLElement {
  const { name, moves } = parameter;
  const key = `${controllet}.${name}`;
  const draft = setter.drafts.get(key);
  // A value that may move an arm is chosen first, and set while a button is held.
  const held = (value: () => Value, set: (value: Value) => Promise<Answer>) =>
    moves
      ? holdButton(
          setter.holding,
          "Set while held",
          async () => {
            const answer = await set(value());
            if (answer.ok) setter.drafts.delete(key);
            return answer;
          },
          { "aria-label": `Set ${spaced(name)} of ${controllet} while held` },
        )
      : null;
  if (parameter.choices) {
    const id = newId("choice");
    let current = String(parameter.value);
    const set = async (value: Value) => {
      const answer = await setter.set(name, value);
      if (answer.ok) current = String(value);
      else if (!moves) select.value = current;
      return answer;
    };
    const chosen = (value: string) => void (moves ? setter.drafts.set(key, value) : set(value));
    const select = choice(parameter.choices, String(draft ?? current), chosen, { id });
    const label = h("label", { for: id, title: parameter.doc }, withoutUnit(name));
    return div(
      "field",
      label,
      select,
      held(() => select.value, set),
    );
  }
  const values = Array.isArray(parameter.value) ? [...parameter.value] : [Number(parameter.value)];
  const bounds = boundsFor(parameter, values);
  if (Array.isArray(draft)) values.splice(0, values.length, ...draft);
  const all = () => (values.length > 1 ? [...values] : values[0]!);
  const label = withoutUnit(parameter.name);
  const sliders = values.map(
    (value, k) =>
      new Slider({
        label: values.length > 1 ? `${label} ${k + 1}` : label,
        ...(parameter.unit ? { unit: parameter.unit } : {}),
        hint: parameter.doc,
        value,
        ...bounds,
        change: (changed) => {
          const before = values[k]!;
          values[k] = changed;
          if (moves) return void setter.drafts.set(key, [...values]);
          void setter.set(name, all()).then((answer) => {
            if (answer.ok) return;
            values[k] = before;
            sliders[k]!.follow(before);
          });
        },
      }),
  );
  const button = held(all, (value) => setter.set(name, value));
  if (sliders.length === 1) return button ? div("", sliders[0]!.element, button) : sliders[0]!.element;
  // Vectors are folded: most of the time all their components are left as they are.
  const head = `${label}${parameter.unit ? ` [${parameter.unit}]` : ""} `;
  const shown = h("summary", { title: parameter.doc }, head, h("span", { class: "number hint" }, summary(values)));
  return h(
    "details",
    { class: "vector", open: draft !== undefined },
    shown,
    ...sliders.map((slider) => slider.element),
    button ?? "",
  );
}

/** A slider needs an end: without one in the descriptor, a few times the present value. */
export function boundsFor({ min, max }: ParameterInfo, values: readonly number[]): { min: number; max: number } {
  const kEndless = 1e6;
  const largest = Math.max(1, ...values.map(Math.abs));
  const low = min !== undefined && Math.abs(min) < kEndless ? min : -4 * largest;
  const high = max !== undefined && Math.abs(max) < kEndless ? max : 4 * largest;
  return { min: low, max: Math.max(high, ...values) };
}

function summary(values: readonly number[]): string {
  return values.map((value) => String(Number(value.toPrecision(3)))).join(", ");
}
