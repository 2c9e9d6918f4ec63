// Summary of one arm: owner, state, distances of its joints from their limits, and faults.
import type { ControlletInfo } from "../model/description.ts";
import { flagged, torqueUse, type ArmInfo, type ArmState, type LiveState, type SceneInfo } from "../model/live.ts";
import type { Session } from "../model/session.ts";
import { button, div, h, replaceChildren, row, setAttribute, setText, toggle, icon } from "../ui/dom.ts";
import { fixed, spaced } from "../ui/words.ts";

/** Numbers of an arm from its controllet and the run, in display order. */
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
    private readonly ask: (word: "recover" | "reconnect") => void,
  ) {
    const name = h("h2", { class: "fill" }, h("span", { class: `dot arm-${(index % 4) + 1}` }), arm.name);
    const rows = h("div", { class: "joints", role: "group", "aria-label": `Joints of ${arm.name}` });
    for (let k = 0; k < arm.joints; ++k) rows.append(this.jointRow(k));
    this.element = h(
      "section",
      { class: "card arm-card", "aria-label": `Arm ${arm.name}` },
      row(name, this.badge),
      row(this.owner, this.features),
      this.error,
      rows,
      this.list,
    );
  }

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
    const [touching, hit] = [flagged(state, "joint_contact"), flagged(state, "joint_collision")];
    this.figure("Joints in contact", touching.length ? touching.join(", ") : undefined);
    this.figure("Joints in collision", hit.length ? hit.join(", ") : undefined, true);
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
    this.figure("Controllet removed by", state.removedBy ? spaced(state.removedBy) : undefined, true);
    const last = state.lastIntervention && state.lastIntervention !== "none" ? state.lastIntervention : "";
    this.figure("Interventions", `${state.interventions}${last && `, ${spaced(last)}`}`);
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
    const what = state.errors.map(spaced).join(", ") || (lost ? "Connection lost" : "Stopped");
    const cure = lost ? ("reconnect" as const) : ("recover" as const);
    replaceChildren(
      this.error,
      h("strong", {}, icon("warning", 14), ` ${what}`),
      state.reason ? h("p", {}, state.reason) : null,
      ...state.cures.map((one) => h("p", {}, h("b", {}, "Do: "), one.cure)),
      row(button(lost ? "Reconnect" : "Recover", () => this.ask(cure))),
    );
  }

  private jointRow(k: number): HTMLElement {
    const position = h("span", { class: "marker" });
    const track = h("span", { class: "track", role: "img" }, position);
    const torque = h("span", { class: "torque" });
    const text = h("span", { class: "number" });
    this.joints.push({ track, position, torque, text });
    const used = h("span", { class: "torque-track", title: "Torque in use" }, torque);
    return div("joint", h("span", { class: "hint" }, `${k + 1}`), track, text, used);
  }

  private showJoint(row: JointRow, k: number, state: ArmState): void {
    const [low = -Math.PI, high = Math.PI, q = NaN] = [this.arm.q_min_rad[k], this.arm.q_max_rad[k], state.q[k]];
    const share = Math.max(0, Math.min(1, (q - low) / (high - low)));
    row.position.style.left = `${(100 * share).toFixed(1)}%`;
    toggle(row.track, "near", share < 0.06 || share > 0.94);
    const use = Math.min(1, Math.abs(state.tau_cmd[k] ?? 0) / (this.arm.tau_max_nm[k] ?? Infinity));
    row.torque.style.width = `${(100 * use).toFixed(0)}%`;
    toggle(row.torque, "high", use > 0.8);
    setText(row.text, fixed(q, 2));
    const range = `${fixed(q, 2)} rad of ${fixed(low, 2)} to ${fixed(high, 2)}`;
    setAttribute(row.track, "aria-label", `Joint ${k + 1}: ${range}, torque ${fixed(100 * use, 0)} %`);
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

// A card for each arm.
export class ArmsPanel {
  readonly element = h("aside", { class: "arms", "aria-label": "Arms", tabindex: 0 });
  private cards: ArmCard[] = [];

  constructor(private readonly session: Session) {}

  build(scene: SceneInfo): void {
    const ask = (arm: string) => (word: string) => void this.session.request(word, { arm });
    this.cards = scene.arms.map((arm, k) => new ArmCard(arm, k, ask(arm.name)));
    replaceChildren(this.element, ...this.cards.map((card) => card.element));
  }

  update(): void {
    const { state } = this.session;
    if (!state) return;
    this.cards.forEach((card, k) => {
      const arm = state.arms[k];
      if (arm) card.update(arm, figuresOf(this.session.controllet(arm.controllet), state));
    });
  }
}

/** Data from the arm's owner: active features, energies in its tanks. */
export function figuresOf(owner: ControlletInfo | undefined, state: LiveState): ArmFigures {
  return {
    features: owner?.features.filter((one) => one.on).map((one) => one.name) ?? [],
    tanks: state.outputs
      .filter((one) => one.controllet === owner?.name && /tank|energy/.test(one.name))
      .map((one) => ({ name: one.name, value: one.values[0] ?? NaN })),
  };
}
