// Connects the WebSocket to the session: news to the model, the page's requests to messages.
import type { PageLine } from "../app.ts";
import { Histogram } from "../model/histogram.ts";
import type { Answer, ControlletInfo } from "../model/description.ts";
import type { LiveState } from "../model/live.ts";
import { kNoControl, type RequestSender, type Session } from "../model/session.ts";
import { decode, type FieldList, type Rows } from "./binary.ts";
import { Connection } from "./connection.ts";
import { kWire, sceneOf, type Hello, type WireControl, type WireEvent } from "./hello.ts";
import { PendingStop, tabStorage } from "./pending_stop.ts";
import { StateReader, type SlowState } from "./state_reader.ts";

const kRate = 60; // [Hz] of states
const kLateAnswer = 500; // time after which an operator is told that a stop is not answered [ms]
const kOwnStop = "Use the arms' own stop.";
const kWide = 64; // numbers per row that a plot may have at every cycle

export interface LineHooks {
  hello(hello: Hello): void;
  /** Rows of the plotted quantities: the time, then the columns. */
  plot(columns: FieldList, rows: number, numbers: Float64Array): void;
  slice(message: Rows<"slice">): void;
  message(text: string): void;
}

export class RunLine implements PageLine, RequestSender {
  hello: Hello | undefined;
  reader: StateReader | undefined;
  /** Milliseconds between sending and arrival of recent states, on the same computer. */
  readonly latencies: number[] = [];
  private readonly connection: Connection;
  private beats = 0;
  private plotId = -1;
  private plotColumns: FieldList = [];
  private watched: string[] = [];
  private askedForControl = false;
  private readonly pendingStop: PendingStop;

  constructor(
    private readonly session: Session,
    private readonly hooks: LineHooks,
    url: string,
    token: string,
  ) {
    this.pendingStop = new PendingStop(token, tabStorage());
    this.connection = new Connection(url, token, {
      opened: (answer) => this.begin(answer["hello"] as Hello),
      text: (message) => this.takeText(message),
      binary: (data) => this.takeBinary(data),
      closed: (why, again) => this.closed(why, again),
      // A log sends nothing unsolicited, nor does a program between two runs.
      isTalking: () => this.hello?.kind === "run",
    });
    session.connect(this);
  }

  open(): void {
    this.connection.open();
  }

  request(word: string, fields: Record<string, unknown>): Promise<Answer> {
    if (word === "control") this.askedForControl = fields["take"] === true;
    return this.connection.request(word, fields);
  }

  send(message: Record<string, unknown>): void {
    this.connection.send(message);
  }

  beat(): void {
    this.connection.send({ beat: ++this.beats });
  }

  release(): void {
    this.connection.send({ release: true });
  }

  /** A stop that a broken connection may have lost is sent again if the connection returns soon, also by a reloaded page. */
  stop(): void {
    this.sendStop(this.pendingStop.press());
  }

  private sendStop(pressedAt: number): void {
    const late = setTimeout(
      () => this.hooks.message(`The run has not answered the stop yet. ${kOwnStop}`),
      kLateAnswer,
    );
    this.connection.hurry();
    void this.session.request("stop").then((answer) => {
      clearTimeout(late);
      if (answer.verdict === "connection_lost")
        return this.hooks.message(
          `The stop may not have reached the run. It is sent again if the connection is back within 30 s. ${kOwnStop}`,
        );
      this.pendingStop.confirm(pressedAt);
      if (answer["no_further_run"]) this.hooks.message("Stopped: no further run is started.");
    });
  }

  private sendPendingStop(): void {
    const due = this.pendingStop.due();
    if (due === undefined) return;
    if (due === "too old")
      return this.hooks.message("A stop that the run has not confirmed is not sent again: it is older than 30 s.");
    this.hooks.message("A stop that the run had not confirmed is sent again.");
    this.sendStop(due);
  }

  watch(names: string[]): void {
    this.watched = names;
    if (this.hello?.kind === "log") return;
    const sizes = new Map(this.hello?.record_fields ?? []);
    const width = names.reduce((sum, name) => sum + (sizes.get(name) ?? 0), 0);
    const every = Math.max(1, Math.ceil(width / kWide));
    void this.session.request("plot", { fields: names, every }).then((answer) => {
      if (!answer.ok) return;
      this.plotId = answer["plot"] as number;
      this.plotColumns = (answer["columns"] as FieldList | undefined) ?? [];
    });
  }

  /** Cycle times of the whole run. */
  async histogram(): Promise<Histogram | undefined> {
    const answer = await this.connection.request("histogram", {});
    const counts = answer["counts"] as number[] | undefined;
    return answer.ok && counts ? new Histogram(counts) : undefined;
  }

  private begin(hello: Hello): void {
    if (hello.wire !== kWire) {
      this.hooks.message(
        `The program uses version ${hello.wire} of the protocol, this page ${kWire}: reload the page.`,
      );
      return;
    }
    this.hello = hello;
    this.sendPendingStop();
    if (!hello.scene) return; // between two runs
    const scene = sceneOf(hello);
    this.reader = new StateReader(hello, scene);
    const { session } = this;
    session.scene = scene;
    session.kind = hello.kind;
    session.state = undefined;
    session.list = hello.list.controllets;
    session.commands = new Set(hello.commands);
    this.setStatus("connected", "");
    session.emit("scene", scene);
    session.emit("list", session.list);
    this.setControl(hello.control);
    this.hooks.hello(hello);
    if (hello.kind === "log") return;
    void session.request("subscribe", { rate_hz: kRate });
    if (this.watched.length > 0) this.watch(this.watched);
  }

  private closed(why: string, again: boolean): void {
    this.session.control = kNoControl;
    this.askedForControl = false;
    this.session.emit("control", kNoControl);
    this.setStatus(again ? "lost" : "refused", why);
    if (!again) this.hooks.message(why);
  }

  private setStatus(status: Session["status"], why: string): void {
    this.session.status = status;
    this.session.why = why;
    this.session.emit("status", status);
  }

  private setControl(control: WireControl | null | undefined): void {
    if (!control) return;
    if (control.mine) this.askedForControl = false;
    const mine = this.hello?.client;
    const asked = this.askedForControl && mine !== undefined && control.requests.includes(mine);
    this.session.control = {
      mine: control.mine,
      taken: control.holder !== null,
      asked,
      requests: control.requests,
      watchers: control.watchers + (control.holder !== null ? 1 : 0),
    };
    this.session.emit("control", this.session.control);
  }

  private takeText(message: Record<string, unknown>): void {
    const { session } = this;
    if (message["hello"]) this.begin(message["hello"] as Hello);
    if (message["state"] && this.reader) this.reader.slow = message["state"] as SlowState;
    for (const event of (message["events"] as WireEvent[] | undefined) ?? []) session.emit("event", event);
    if (message["list"]) {
      session.list = (message["list"] as { controllets: ControlletInfo[] }).controllets;
      session.emit("list", session.list);
    }
    if (message["control"] && typeof message["control"] === "object")
      this.setControl(message["control"] as WireControl);
    const released = message["released"] as { cause: string } | undefined;
    if (released) session.emit("released", released.cause);
    const ended = message["ended"] as { reason: string } | undefined;
    if (ended) this.setStatus("refused", ended.reason);
    if (message["ok"] === false) {
      session.emit("refused", { request: "sample", reason: String(message["reason"] ?? message["verdict"]) });
    }
  }

  private takeBinary(data: ArrayBuffer): void {
    const message = decode(data);
    if (!message) return;
    if (message.kind === "plot") {
      if (message.id === this.plotId) this.hooks.plot(this.plotColumns, message.rows, message.numbers);
    } else if (message.kind === "slice") {
      this.hooks.slice(message);
    } else if (this.reader && message.numbers.length === this.reader.numbers) {
      this.show(this.reader.read(message.numbers));
      this.connection.send({ seen: message.number });
    }
  }

  private show(state: LiveState): void {
    this.latencies.push(Date.now() - state.sent_ms);
    if (this.latencies.length > 600) this.latencies.shift();
    this.session.take(state);
  }
}
