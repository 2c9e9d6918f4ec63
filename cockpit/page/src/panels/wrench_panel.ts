// A wrench target for laws that control forces: it presses while its button is held.
import type { Session } from "../model/session.ts";
import type { Holding } from "../safety/holding.ts";
import { WrenchMotion } from "../teleop/motions.ts";
import { h } from "../ui/dom.ts";
import { Slider } from "./slider.ts";

const kMostForce = 40; // [N]
const kMostMoment = 6; // [N m]

export function wrenchPanel(session: Session, holding: Holding, arm: () => string): HTMLElement {
  const slider = (label: string, unit: string, most: number) =>
    new Slider({ label, unit, min: -most, max: most, value: 0, step: most > 10 ? 0.5 : 0.1 });
  const forces = ["x", "y", "z"].map((axis) => slider(`Force ${axis}`, "N", kMostForce));
  const moments = ["x", "y", "z"].map((axis) => slider(`Moment ${axis}`, "N m", kMostMoment));
  const press = h("button", { type: "button", class: "hold", "aria-label": "Press while held" }, "Hold to press");
  const motion = new WrenchMotion(session, arm, () => ({
    force_n: forces.map((one) => one.value),
    torque_nm: moments.map((one) => one.value),
  }));
  holding.bindButton(press, "press", motion);
  return h(
    "details",
    { class: "section" },
    h("summary", {}, "Wrench target"),
    h("p", { class: "hint" }, "What the hand exerts on its surroundings, in world axes. Down is −z."),
    ...forces.map((one) => one.element),
    h("details", {}, h("summary", {}, "Moments"), ...moments.map((one) => one.element)),
    press,
  );
}
