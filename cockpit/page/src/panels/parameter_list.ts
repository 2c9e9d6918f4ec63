// Fields for the parameters of a controllet, made from its descriptor: unit, bounds and help come from there.
import type { Answer, ControlletInfo, ParameterInfo } from "../model/description.ts";
import { h, newId } from "../ui/dom.ts";
import { nameAndUnit } from "../ui/words.ts";
import { Slider } from "./slider.ts";

export type SetParameter = (controllet: string, name: string, value: number | number[] | string) => Promise<Answer>;

export function parameterList(controllet: ControlletInfo, set: SetParameter): HTMLElement {
  const list = h("div", { class: "parameters" });
  for (const parameter of controllet.parameters) list.append(field(controllet, parameter, set));
  if (controllet.parameters.length === 0) list.append(h("p", { class: "hint" }, "It has no parameters."));
  return list;
}

function field(controllet: ControlletInfo, parameter: ParameterInfo, set: SetParameter): HTMLElement {
  if (parameter.choices) return choice(controllet, parameter, parameter.choices, set);
  const values = Array.isArray(parameter.value) ? [...parameter.value] : [Number(parameter.value)];
  const bounds = boundsFor(parameter, values);
  const label = labelOf(parameter);
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
          void set(controllet.name, parameter.name, values.length > 1 ? [...values] : changed).then((answer) => {
            if (answer.ok) return;
            values[k] = before;
            sliders[k]!.follow(before);
          });
        },
      }),
  );
  if (sliders.length === 1) return sliders[0]!.element;
  // Vectors are folded: most of the time all their components are left as they are.
  return h(
    "details",
    { class: "vector" },
    h(
      "summary",
      { title: parameter.doc },
      `${label}${parameter.unit ? ` [${parameter.unit}]` : ""} `,
      h("span", { class: "number hint" }, summary(values)),
    ),
    ...sliders.map((slider) => slider.element),
  );
}

function choice(
  controllet: ControlletInfo,
  parameter: ParameterInfo,
  choices: string[],
  set: SetParameter,
): HTMLElement {
  const id = newId("choice");
  const select = h("select", { id });
  for (const name of choices) select.append(h("option", { value: name }, name));
  let current = String(parameter.value);
  select.value = current;
  select.addEventListener("change", () => {
    void set(controllet.name, parameter.name, select.value).then((answer) => {
      if (answer.ok) current = select.value;
      else select.value = current;
    });
  });
  return h("div", { class: "field" }, h("label", { for: id, title: parameter.doc }, labelOf(parameter)), select);
}

// The unit stands behind the name anyway, so the name goes without it.
const labelOf = (parameter: ParameterInfo): string => nameAndUnit(parameter.name).name;

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
