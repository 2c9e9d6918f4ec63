// One arm at a glance: who owns it, how it is, how far its joints are from their limits, and what is wrong.
import { torqueUse, type ArmInfo, type ArmState } from "../model/live.ts";
import { h, replaceChildren, setAttribute, setText, toggle } from "../ui/dom.ts";
import { icon } from "../ui/icons.ts";
import { fixed, spaced } from "../ui/words.ts";

/** Numbers of an arm that come from its controllet and from the run, in the order in which they are shown. */
export interface ArmFigures {
  features: string[];
  /** Fill of the energy tanks, 0 to 1, by name. */
  tanks: { name: string; value: number }[];
}

interface JointRow {
  track: HTMLElement;
  position: HTMLElement;
  torque: HTMLElement;
  text: HTMLElement;
}

export class ArmCard {
  readonly element: HTMLElement;
  private readonly badge = h("span", { class: "badge" });
  private readonly owner = h("span", { class: "owner" });
  private readonly features = h("span", { class: "hint" });
  private readonly error = h("div", { class: "error-note", role: "alert", hidden: true });
  private readonly joints: JointRow[] = [];
  private readonly figures = new Map<string, { row: HTMLElement; value: HTMLElement }>();
  private readonly list = h("dl", { class: "figures" });
  private lastError = "";

  constructor(
    private readonly arm: ArmInfo,
    index: number,
    recover: () => void,
    reconnect: () => void,
  ) {
    const name = h("h2", { class: "fill" }, h("span", { class: `dot arm-${(index % 4) + 1}` }), arm.name);
    const rows = h("div", { class: "joints", role: "group", "aria-label": `Joints of ${arm.name}` });
    for (let k = 0; k < arm.joints; ++k) rows.append(this.jointRow(k));
    this.element = h(
      "section",
      { class: "card arm-card", "aria-label": `Arm ${arm.name}` },
      h("div", { class: "row" }, name, this.badge),
      h("div", { class: "row" }, this.owner, this.features),
      this.error,
      rows,
      this.list,
    );
    this.recover = recover;
    this.reconnect = reconnect;
  }

  private readonly recover: () => void;
  private readonly reconnect: () => void;

  update(state: ArmState, figures: ArmFigures): void {
    this.showMode(state);
    setText(this.owner, state.controllet || "no controllet");
    setText(this.features, figures.features.length ? `+ ${figures.features.map(spaced).join(", ")}` : "");
    this.showError(state);
    this.joints.forEach((row, k) => this.showJoint(row, k, state));
    const use = torqueUse(this.arm, state);
    this.figure("Torque in use", `${fixed(100 * use.share, 0)} %, joint ${use.joint + 1}`, use.share > 0.9);
    this.figure("Hand", state.hand.position.map((x) => fixed(x, 3)).join("  ") + " m");
    this.figure("Tracking error", trackingText(state));
    const force = state.wrench ? Math.hypot(state.wrench[0]!, state.wrench[1]!, state.wrench[2]!) : undefined;
    this.figure("Estimated force", force === undefined ? undefined : `${fixed(force, 1)} N`);
    this.figure("Manipulability", state.manipulability === undefined ? undefined : fixed(state.manipulability, 3));
    for (const tank of figures.tanks) this.figure(`Tank ${tank.name}`, `${fixed(tank.value, 2)} J`);
    const { connection, gripper } = state;
    if (connection) {
      const sent = connection.received + connection.lost;
      const loss = sent > 0 ? (100 * connection.lost) / sent : 0;
      this.figure("Packets lost", `${connection.lost} (${fixed(loss, 2)} %), ${connection.late} late`, loss > 1);
      this.figure("Commands in time", `${fixed(100 * connection.success, 1)} %`, connection.success < 0.95);
    }
    this.figure("Age of the state", state.age_s > 0.003 ? `${fixed(1000 * state.age_s, 0)} ms` : undefined, true);
    if (gripper) {
      const holds = gripper.grasped ? ", holds" : gripper.moving ? ", moves" : "";
      this.figure("Gripper", `${fixed(1000 * gripper.width_m, 1)} mm${holds}`);
    }
    const last =
      state.lastIntervention && state.lastIntervention !== "none" ? `, ${spaced(state.lastIntervention)}` : "";
    this.figure("Interventions", `${state.interventions}${last}`);
  }

  private showMode(state: ArmState): void {
    const bad = state.errors.length > 0 || state.mode === "error" || state.mode === "reflex";
    const text = state.stopped ? "stopped" : spaced(state.mode);
    setText(this.badge, text);
    toggle(this.badge, "bad", bad);
    toggle(this.badge, "warning", !bad && state.stopped);
    toggle(this.badge, "good", !bad && !state.stopped);
  }

  private showError(state: ArmState): void {
    const lost = state.mode === "lost" || state.mode === "disconnected";
    const shown = state.errors.length > 0 || state.reason || lost;
    const key = `${state.errors.join()}|${state.reason}|${JSON.stringify(state.cures)}|${lost}`;
    if (key === this.lastError) return;
    this.lastError = key;
    this.error.hidden = !shown;
    const act = (text: string, go: () => void) => h("button", { type: "button", onclick: go }, text);
    replaceChildren(
      this.error,
      h(
        "strong",
        {},
        icon("warning", 14),
        ` ${state.errors.map(spaced).join(", ") || (lost ? "Connection lost" : "Stopped")}`,
      ),
      state.reason ? h("p", {}, state.reason) : null,
      ...state.cures.map(({ cure }) => h("p", {}, h("b", {}, "Do: "), cure)),
      h("div", { class: "row" }, lost ? act("Reconnect", this.reconnect) : act("Recover", this.recover)),
    );
  }

  private jointRow(k: number): HTMLElement {
    const position = h("span", { class: "marker" });
    const track = h("span", { class: "track", role: "img" }, position);
    const torque = h("span", { class: "torque" });
    const text = h("span", { class: "number" });
    this.joints.push({ track, position, torque, text });
    return h(
      "div",
      { class: "joint" },
      h("span", { class: "hint" }, `${k + 1}`),
      track,
      text,
      h("span", { class: "torque-track", title: "Torque in use" }, torque),
    );
  }

  private showJoint(row: JointRow, k: number, state: ArmState): void {
    const [low = -Math.PI, high = Math.PI, q = NaN] = [this.arm.q_min[k], this.arm.q_max[k], state.q[k]];
    const share = Math.max(0, Math.min(1, (q - low) / (high - low)));
    row.position.style.left = `${(100 * share).toFixed(1)}%`;
    toggle(row.track, "near", share < 0.06 || share > 0.94);
    const use = Math.min(1, Math.abs(state.tau_cmd[k] ?? 0) / (this.arm.tau_max[k] ?? Infinity));
    row.torque.style.width = `${(100 * use).toFixed(0)}%`;
    toggle(row.torque, "high", use > 0.8);
    setText(row.text, fixed(q, 2));
    setAttribute(
      row.track,
      "aria-label",
      `Joint ${k + 1}: ${fixed(q, 2)} rad of ${fixed(low, 2)} to ${fixed(high, 2)}, torque ${fixed(100 * use, 0)} %`,
    );
  }

  private figure(name: string, value: string | undefined, alarming = false): void {
    let known = this.figures.get(name);
    if (!known) {
      if (value === undefined) return;
      known = { row: h("div", {}), value: h("dd", { class: "number" }) };
      known.row.append(h("dt", {}, name), known.value);
      this.figures.set(name, known);
      this.list.append(known.row);
    }
    known.row.hidden = value === undefined;
    if (value === undefined) return;
    setText(known.value, value);
    toggle(known.value, "alarming", alarming);
  }
}

function trackingText({ tracking, trackingUnit }: ArmState): string | undefined {
  if (tracking === undefined) return undefined;
  return trackingUnit === "m" || trackingUnit === "rad"
    ? `${fixed(1000 * tracking, 1)} m${trackingUnit}`
    : fixed(tracking, 3);
}
