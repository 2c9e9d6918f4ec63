// What is asked of one arm: gripper, load, recovery, its stop button.
import type { Session } from "../model/session.ts";
import { h, replaceChildren } from "../ui/dom.ts";
import { Slider } from "./slider.ts";

const kUsualWidth = 0.08; // [m] of Franka's hand

export class ArmToolsPanel {
  readonly element = h("div", {});
  private built = "";
  private readonly result = h("p", { class: "hint", role: "status" });

  constructor(private readonly session: Session) {
    const rebuild = () => this.build();
    session.on("scene", () => {
      this.built = "";
      rebuild();
    });
    session.on("control", rebuild);
    session.on("state", rebuild); // whether an arm has a gripper shows in its state
  }

  private build(): void {
    const { scene, state, control } = this.session;
    if (!scene) return;
    // A gripper knows how far it opens after homing only.
    const grippers = state?.arms.map((arm) => (arm.gripper ? arm.gripper.max_width_m || kUsualWidth : -1)) ?? [];
    const key = JSON.stringify([scene.name, scene.arms.map((arm) => arm.name), grippers, control.mine]);
    if (key === this.built) return;
    this.built = key;
    const sections = scene.arms.map((arm, k) =>
      h(
        "fieldset",
        { class: "section plain", disabled: !control.mine },
        h("legend", {}, h("h2", {}, arm.name)),
        grippers[k] !== undefined && grippers[k] >= 0 ? this.gripper(arm.name, grippers[k]) : null,
        arm.vacuum ? this.vacuum(arm.name) : null,
        this.load(arm.name),
        this.recovery(arm.name, scene.simulated),
      ),
    );
    replaceChildren(this.element, ...sections, this.result);
  }

  private ask(word: string, fields: Record<string, unknown>, done: string): void {
    this.result.textContent = "…";
    void this.session.request(word, fields).then((answer) => {
      const message = typeof answer["message"] === "string" ? answer["message"] : done;
      this.result.textContent = answer.ok ? message : `Refused: ${answer.reason ?? answer.verdict}`;
    });
  }

  private button(
    text: string,
    word: string,
    fields: () => Record<string, unknown>,
    done: string,
    arm: string,
  ): HTMLElement {
    const element = h("button", { type: "button", "aria-label": `${text}: ${arm}` }, text);
    element.addEventListener("click", () => this.ask(word, { arm, ...fields() }, done));
    return element;
  }

  private gripper(arm: string, most: number): HTMLElement {
    const width = new Slider({ label: "Width", unit: "m", min: 0, max: most, step: 0.001, value: most });
    const force = new Slider({ label: "Force", unit: "N", min: 5, max: 70, step: 1, value: 20 });
    const action =
      (action: string, more: () => object = () => ({})) =>
      () => ({ action, ...more() });
    const move = () => ({ width_m: width.value, speed_m_per_s: 0.05 });
    const grasp = () => ({ ...move(), force_n: force.value, tolerance_m: 0.08 });
    return h(
      "div",
      {},
      h("h3", {}, "Gripper"),
      width.element,
      force.element,
      h(
        "div",
        { class: "row" },
        this.button(
          "Open",
          "gripper",
          action("move", () => ({ width_m: most, speed_m_per_s: 0.05 })),
          "Opened.",
          arm,
        ),
        this.button("Move gripper", "gripper", action("move", move), "Moved.", arm),
        this.button("Grasp", "gripper", action("grasp", grasp), "Grasped.", arm),
        this.button("Homing", "gripper", action("homing"), "Homed.", arm),
        this.button("Stop gripper", "gripper", action("stop"), "Stopped.", arm),
      ),
    );
  }

  private vacuum(arm: string): HTMLElement {
    const on = () => ({ action: "on", vacuum_mbar: 500, timeout_s: 3 });
    return h(
      "div",
      { class: "row" },
      h("h3", { class: "fill" }, "Vacuum gripper"),
      this.button("Suck", "vacuum", on, "It holds.", arm),
      this.button("Drop", "vacuum", () => ({ action: "drop", timeout_s: 3 }), "Dropped.", arm),
      this.button("Stop vacuum", "vacuum", () => ({ action: "stop" }), "Stopped.", arm),
    );
  }

  private load(arm: string): HTMLElement {
    const mass = new Slider({ label: "Mass", unit: "kg", min: 0, max: 5, step: 0.05, value: 0 });
    const height = new Slider({ label: "Center of mass, z", unit: "m", min: -0.1, max: 0.3, step: 0.005, value: 0 });
    const fields = () => {
      // The inertia of a ball of that mass with a radius of 4 cm: any positive one serves a load at rest.
      const inertia = 0.4 * mass.value * 0.04 ** 2;
      return {
        mass_kg: mass.value,
        com_m: [0, 0, height.value],
        inertia_kg_m2: { xx: inertia, yy: inertia, zz: inertia, xy: 0, xz: 0, yz: 0 },
      };
    };
    return h(
      "details",
      {},
      h("summary", {}, "Load"),
      mass.element,
      height.element,
      this.button("Declare load", "set_load", fields, "Declared.", arm),
    );
  }

  private recovery(arm: string, simulated: boolean): HTMLElement {
    return h(
      "div",
      { class: "row" },
      this.button("Recover", "recover", () => ({}), "Recovered; the arm is held.", arm),
      this.button("Reconnect", "reconnect", () => ({}), "Connected; the arm is held.", arm),
      simulated ? this.button("Press user stop", "user_stop", () => ({ pressed: true }), "Pressed.", arm) : null,
      simulated ? this.button("Release user stop", "user_stop", () => ({ pressed: false }), "Released.", arm) : null,
    );
  }
}
