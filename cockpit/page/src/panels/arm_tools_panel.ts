// Requests to one arm: gripper, load, recovery, user stop.
import type { Session } from "../model/session.ts";
import { outcome } from "../model/description.ts";
import type { Holding } from "../safety/holding.ts";
import { button, div, fold, h, replaceChildren, row } from "../ui/dom.ts";
import { holdButton, isHeldIn, Slider } from "./controls.ts";

const kUsualWidth = 0.08; // [m] of Franka's hand

export class ArmToolsPanel {
  readonly element = h("div", {});
  private built = "";
  private readonly result = h("p", { class: "hint", role: "status" });

  constructor(
    private readonly session: Session,
    private readonly holding: Holding,
  ) {
    const rebuild = () => this.build();
    session.on("scene", () => {
      this.built = "";
      rebuild();
    });
    session.on("control", rebuild);
    session.on("state", rebuild); // the state shows whether an arm has a gripper
  }

  private build(): void {
    const { scene, state, control } = this.session;
    if (!scene) return;
    // A gripper's largest width is known only after homing.
    const grippers = state?.arms.map((arm) => (arm.gripper ? arm.gripper.max_width_m || kUsualWidth : -1)) ?? [];
    const key = JSON.stringify([scene.name, scene.arms.map((arm) => arm.name), grippers, control.mine]);
    if (key === this.built || isHeldIn(this.element)) return;
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

  private button(text: string, arm: string, word: string, fields: () => object, done: string, moves = false) {
    const ask = async () => {
      this.result.textContent = "…";
      const answer = await this.session.request(word, { arm, ...fields() });
      this.result.textContent = outcome(answer, typeof answer["message"] === "string" ? answer["message"] : done);
      return answer;
    };
    if (moves) return holdButton(this.holding, text, ask, { "aria-label": `${text} while held: ${arm}` });
    return button(text, () => void ask(), { "aria-label": `${text}: ${arm}` });
  }

  private gripper(arm: string, most: number): HTMLElement {
    const width = new Slider({ label: "Width", unit: "m", min: 0, max: most, step: 0.001, value: most });
    const force = new Slider({ label: "Force", unit: "N", min: 5, max: 70, step: 1, value: 20 });
    const act = (text: string, action: string, done: string, more: () => object = () => ({})) =>
      this.button(text, arm, "gripper", () => ({ action, ...more() }), done, action !== "stop");
    const move = (width_m: number) => ({ width_m, speed_m_per_s: 0.05 });
    const grasp = () => ({ ...move(width.value), force_n: force.value, tolerance_m: 0.08 });
    return div(
      "",
      h("h3", {}, "Gripper"),
      width.element,
      force.element,
      row(
        act("Open", "move", "Opened.", () => move(most)),
        act("Move gripper", "move", "Moved.", () => move(width.value)),
        act("Grasp", "grasp", "Grasped.", grasp),
        act("Homing", "homing", "Homed."),
        act("Stop gripper", "stop", "Stopped."),
      ),
    );
  }

  private vacuum(arm: string): HTMLElement {
    const act = (text: string, fields: object, done: string) =>
      this.button(text, arm, "vacuum", () => fields, done, text !== "Stop vacuum");
    return row(
      h("h3", { class: "fill" }, "Vacuum gripper"),
      act("Suck", { action: "on", vacuum_mbar: 500, timeout_s: 3 }, "It holds."),
      act("Drop", { action: "drop", timeout_s: 3 }, "Dropped."),
      act("Stop vacuum", { action: "stop" }, "Stopped."),
    );
  }

  private load(arm: string): HTMLElement {
    const mass = new Slider({ label: "Mass", unit: "kg", min: 0, max: 5, step: 0.05, value: 0 });
    const height = new Slider({ label: "Center of mass, z", unit: "m", min: -0.1, max: 0.3, step: 0.005, value: 0 });
    const fields = () => {
      // Inertia of a ball of that mass with a radius of 4 cm: any positive one is sufficient for a load
      // at rest.
      const inertia = 0.4 * mass.value * 0.04 ** 2;
      const inertia_kg_m2 = { xx: inertia, yy: inertia, zz: inertia, xy: 0, xz: 0, yz: 0 };
      return { mass_kg: mass.value, com_m: [0, 0, height.value], inertia_kg_m2 };
    };
    const declare = this.button("Declare load", arm, "set_load", fields, "Declared.", true);
    return fold("Load", mass.element, height.element, declare);
  }

  private recovery(arm: string, simulated: boolean): HTMLElement {
    const act = (text: string, word: string, done: string, fields = {}) =>
      this.button(text, arm, word, () => fields, done);
    return row(
      act("Recover", "recover", "Recovered; the arm is held."),
      act("Reconnect", "reconnect", "Connected; the arm is held."),
      simulated ? act("Press user stop", "user_stop", "Pressed.", { pressed: true }) : null,
      simulated ? act("Release user stop", "user_stop", "Released.", { pressed: false }) : null,
    );
  }
}
