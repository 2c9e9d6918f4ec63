// Moving by hand: which arm, along which axes, how fast, how hard, and with which device.
import type { Session } from "../model/session.ts";
import type { Holding, Motion } from "../safety/holding.ts";
import type { Deflection, JogAxes } from "../teleop/jog.ts";
import { address, kDefaultJog, type JogSettings } from "../teleop/motions.ts";
import { h, newId, replaceChildren, setText } from "../ui/dom.ts";
import { jogPad } from "./jog_pad.ts";
import { JointSliders } from "./joint_sliders.ts";
import { Slider } from "./slider.ts";
import { wrenchPanel } from "./wrench_panel.ts";

export class MovePanel {
  readonly element = h("div", {});
  readonly settings: JogSettings = { ...kDefaultJog };
  arm = "";
  /** The second hand, for devices that lead two. */
  secondArm = "";
  private readonly arms = h("div", { class: "section" });
  private readonly advice = h("p", { class: "warning-note", role: "status", hidden: true });
  private readonly joints: JointSliders;

  constructor(
    private readonly session: Session,
    holding: Holding,
    motion: (deflection: () => Deflection) => Motion,
    private readonly armChanged: () => void,
    devices: HTMLElement,
    gizmo: (on: boolean) => void,
  ) {
    this.joints = new JointSliders(session, holding, () => this.settings);
    const drag = h("input", { type: "checkbox" });
    drag.addEventListener("change", () => gizmo(drag.checked));
    const jointBox = h("details", { class: "section" }, h("summary", {}, "Joints"), this.joints.element);
    this.element.append(
      this.arms,
      this.advice,
      h(
        "div",
        { class: "section" },
        h("h2", {}, "Jog"),
        jogPad(holding, motion),
        h("label", { class: "check" }, drag, "Drag the target in the picture"),
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
    const choice = (label: string, current: string, choose: (name: string) => void, none: boolean) => {
      const id = newId("arm");
      const select = h("select", { id, class: "fill" });
      if (none) select.append(h("option", { value: "" }, "none"));
      for (const name of names) select.append(h("option", { value: name }, name));
      select.value = current;
      select.addEventListener("change", () => {
        choose(select.value);
        this.armChanged();
        this.update();
      });
      return h("div", { class: "row" }, h("label", { for: id, class: "arm-label" }, label), select);
    };
    replaceChildren(
      this.arms,
      choice("Arm", this.arm, (name) => (this.arm = name), false),
      names.length > 1 ? choice("Second hand", this.secondArm, (name) => (this.secondArm = name), true) : null,
    );
    this.armChanged();
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
