// One page's view of one run: the scene, the newest state, the controllets, control, and requests.
import type { Answer, ControlletInfo, InputInfo } from "./description.ts";
import type { LiveState, SceneInfo } from "./live.ts";
import type { TimelineEvent } from "./timeline.ts";

export type LineStatus = "connecting" | "connected" | "lost" | "refused";

export interface Control {
  /** This page has control. */
  mine: boolean;
  /** Another page has control. */
  taken: boolean;
  /** This page has requested it. */
  asked: boolean;
  /** Pages that request it. */
  requests: number[];
  watchers: number;
}

export const kNoControl: Control = { mine: false, taken: false, asked: false, requests: [], watchers: 0 };

interface SessionEvents {
  scene: SceneInfo;
  state: LiveState;
  list: readonly ControlletInfo[];
  control: Control;
  event: TimelineEvent;
  status: LineStatus;
  /** A request was refused: shown as a message. */
  refused: { request: string; reason: string };
  /** The run has ended this page's hold. */
  released: string;
}

export interface RequestSender {
  request(word: string, fields: Record<string, unknown>): Promise<Answer>;
  /** Without an answer: samples of streams, beats. */
  send(message: Record<string, unknown>): void;
}

export class Session {
  scene: SceneInfo | undefined;
  state: LiveState | undefined;
  /** Time of this computer at which the newest state arrived [ms]. */
  arrived = -Infinity;
  list: readonly ControlletInfo[] = [];
  control: Control = kNoControl;
  status: LineStatus = "connecting";
  kind: "run" | "virtual_arm" | "log" = "run";
  /** Requests accepted by the other end. */
  commands: ReadonlySet<string> = new Set();
  why = "";
  private readonly listeners = new Map<string, ((value: never) => void)[]>();

  constructor(private sender: RequestSender | undefined = undefined) {}

  connect(sender: RequestSender): void {
    this.sender = sender;
  }

  on<K extends keyof SessionEvents>(name: K, call: (value: SessionEvents[K]) => void): void {
    const known = this.listeners.get(name) ?? [];
    known.push(call as (value: never) => void);
    this.listeners.set(name, known);
  }

  emit<K extends keyof SessionEvents>(name: K, value: SessionEvents[K]): void {
    for (const call of this.listeners.get(name) ?? []) call(value as never);
  }

  take(state: LiveState): void {
    this.state = state;
    this.arrived = performance.now();
    this.emit("state", state);
  }

  /** Sends a request; a refusal is shown and returned. */
  async request(word: string, fields: Record<string, unknown> = {}): Promise<Answer> {
    if (!this.sender) return { ok: false, verdict: "loop_not_running", reason: "There is no connection to the run." };
    const answer = await this.sender.request(word, fields);
    if (!answer.ok) this.emit("refused", { request: word, reason: answer.reason ?? answer.verdict ?? "refused" });
    return answer;
  }

  send(message: Record<string, unknown>): void {
    this.sender?.send(message);
  }

  controllet(name: string): ControlletInfo | undefined {
    return this.list.find((one) => one.name === name);
  }

  /** The controllet that owns an arm. */
  ownerOf(arm: string): ControlletInfo | undefined {
    const k = this.armIndex(arm);
    const owner = this.state?.arms[k]?.controllet;
    return owner ? this.controllet(owner) : this.list.find((one) => one.active && one.arms.includes(arm));
  }

  armIndex(name: string): number {
    return this.scene?.arms.findIndex((arm) => arm.name === name) ?? -1;
  }

  /** The input of the arm's owner for this quantity; the arm's own one before a common one. */
  inputFor(arm: string, quantity: InputInfo["quantity"]): { controllet: ControlletInfo; input: InputInfo } | undefined {
    const controllet = this.ownerOf(arm);
    if (!controllet) return undefined;
    const fitting = controllet.inputs.filter((input) => input.quantity === quantity);
    const input = fitting.find((one) => one.arm === arm) ?? fitting[0];
    return input ? { controllet, input } : undefined;
  }

  /** The set-point of an input in the newest state. */
  reference(controllet: string, input: string): ArrayLike<number> | undefined {
    return this.state?.references.find((one) => one.controllet === controllet && one.input === input)?.values;
  }
}
