// Manual motion: arm, axes, speed, force and device.
import type { Session } from "../model/session.ts";
import { jogPad, Slider } from "./controls.ts";
import { JointSliders } from "./joint_sliders.ts";
import type { Holding, Motion } from "../safety/holding.ts";
import type { Deflection, JogAxes } from "../teleop/jog.ts";
import { address, kDefaultJog, type JogSettings, WrenchMotion } from "../teleop/motions.ts";
import { check, choice, div, h, newId, replaceChildren, row, section, setText, button, fold } from "../ui/dom.ts";

export class MovePanel {
  readonly element = h("div", {});
  readonly settings: JogSettings = { ...kDefaultJog };
  arm = "";
  /** The second hand, for devices that move two. */
  secondArm = "";
  private readonly arms = div("section");
  private readonly advice = h("p", { class: "warning-note", role: "status", hidden: true });
  private readonly joints: JointSliders;

  constructor(
    private readonly session: Session,
    holding: Holding,
    motion: (deflection: () => Deflection) => Motion,
    devices: HTMLElement,
    gizmo: (on: boolean) => void,
  ) {
    this.joints = new JointSliders(session, holding, () => this.settings);
    const jointBox = h("details", { class: "section" }, h("summary", {}, "Joints"), this.joints.element);
    this.element.append(
      this.arms,
      this.advice,
      section(
        "Jog",
        jogPad(holding, motion),
        check("Drag the target in the picture", gizmo),
        this.axesChoice(),
        this.limit("Speed", "m/s", 0.005, 0.25, "speed_m_per_s", 0.005),
        this.limit("Turning speed", "rad/s", 0.05, 1, "turn_rad_per_s", 0.05),
        this.limit("Joint speed", "rad/s", 0.05, 1, "joint_rad_per_s", 0.05),
        this.limit("Force limit", "N", 2, 60, "force_n", 1),
      ),
      devices,
      jointBox,
      wrenchPanel(session, holding, () => this.arm),
    );
    session.on("scene", (scene) => {
      this.arm = scene.arms[0]?.name ?? "";
      this.secondArm = scene.arms[1]?.name ?? "";
      this.buildArms();
    });
  }

  update(): void {
    const { scene, state } = this.session;
    const k = this.session.armIndex(this.arm);
    if (!scene || k < 0) return;
    this.joints.build(scene.arms[k]!);
    if (state) this.joints.update(state.arms[k]!);
    const found = this.session.control.mine ? address(this.session, this.arm, "pose") : "";
    const why = typeof found === "string" ? found : "";
    this.advice.hidden = why === "";
    setText(this.advice, why);
  }

  private buildArms(): void {
    const names = this.session.scene?.arms.map((arm) => arm.name) ?? [];
    const chosen = (label: string, key: "arm" | "secondArm", more: [string, string][] = []) => {
      const id = newId("arm");
      const set = (name: string) => {
        this[key] = name;
        this.update();
      };
      const select = choice([...more, ...names], this[key], set, { id, class: "fill" });
      return row(h("label", { for: id, class: "arm-label" }, label), select);
    };
    const second = names.length > 1 ? chosen("Second hand", "secondArm", [["", "none"]]) : null;
    replaceChildren(this.arms, chosen("Arm", "arm"), second);
  }

  private axesChoice(): HTMLElement {
    const group = h(
      "div",
      { class: "row", role: "radiogroup", "aria-label": "Axes" },
      h("span", { class: "hint" }, "Axes"),
    );
    const name = newId("axes");
    for (const [axes, text] of [
      ["camera", "Camera"],
      ["base", "Base"],
      ["hand", "Hand"],
    ] as [JogAxes, string][]) {
      const radio = h("input", { type: "radio", name, value: axes, checked: axes === this.settings.axes });
      radio.addEventListener("change", () => (this.settings.axes = axes));
      group.append(h("label", { class: "check" }, radio, text));
    }
    return group;
  }

  private limit(
    label: string,
    unit: string,
    min: number,
    max: number,
    key: "speed_m_per_s" | "turn_rad_per_s" | "joint_rad_per_s" | "force_n",
    step: number,
  ): HTMLElement {
    const set = (value: number) => (this.settings[key] = value);
    return new Slider({ label, unit, min, max, step, value: this.settings[key], input: set, change: set }).element;
  }
}

// A wrench target for laws that control forces: it presses while its button is held.
const kMostForce = 40; // [N]
const kMostMoment = 6; // [N m]

export function wrenchPanel(session: Session, holding: Holding, arm: () => string): HTMLElement {
  const slider = (label: string, unit: string, most: number) =>
    new Slider({ label, unit, min: -most, max: most, value: 0, step: most > 10 ? 0.5 : 0.1 });
  const forces = ["x", "y", "z"].map((axis) => slider(`Force ${axis}`, "N", kMostForce));
  const moments = ["x", "y", "z"].map((axis) => slider(`Moment ${axis}`, "N m", kMostMoment));
  const press = button("Hold to press", undefined, { class: "hold", "aria-label": "Press while held" });
  const motion = new WrenchMotion(session, arm, () => ({
    force_n: forces.map((one) => one.value),
    torque_nm: moments.map((one) => one.value),
  }));
  holding.bindButton(press, "press", motion);
  return h(
    "details",
    { class: "section" },
    h("summary", {}, "Wrench target"),
    h("p", { class: "hint" }, "Wrench of the hand on its environment, in world axes. Down is −z."),
    ...forces.map((one) => one.element),
    fold("Moments", ...moments.map((one) => one.element)),
    press,
  );
}
