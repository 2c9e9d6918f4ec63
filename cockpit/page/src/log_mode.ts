// The page for a recorded log: the player replaces the run, plots show the whole log.
import type { App } from "./app.ts";
import { LogPlayer, type Slice } from "./model/log_player.ts";
import type { LogPanel } from "./panels/log_panel.ts";
import type { Answer } from "./model/description.ts";
import { World } from "./scene3d/world.ts";
import type { FieldList, Rows } from "./wire/binary.ts";
import { sceneOf, type Hello } from "./wire/hello.ts";
import { StateReader } from "./wire/state_reader.ts";

const kRate = 60; // [Hz] of states that are played
const kPlotRows = 3000;

export class LogMode {
  private readonly slices = new Map<number, (slice: Slice) => void>();
  private player: LogPlayer | undefined;
  private second: World | undefined;
  private hello: Hello | undefined;

  constructor(
    private readonly app: App,
    private readonly panel: LogPanel,
  ) {}

  begin(hello: Hello): void {
    const logs = hello.logs ?? [];
    if (logs.length === 0) return;
    this.hello = hello;
    const scene = sceneOf(hello);
    const reader = new StateReader(hello, scene);
    this.second?.dispose();
    if (logs.length > 1) {
      this.second = new World(this.app.view.stage, scene, true);
      this.app.paintAlso(this.second);
    }
    for (const event of logs[0]!.events) this.app.session.emit("event", event);
    this.player = new LogPlayer(
      logs,
      (log, from_s, to_s) => this.ask("log_states", { log, from_s, to_s, rate_hz: kRate }),
      (log, t_s) => this.ask("log_state", { log, t_s }),
      (log, numbers) => {
        if (numbers.length !== reader.numbers) return;
        const state = reader.read(numbers);
        if (log === 0) this.app.session.take(state);
        else this.second?.show(state);
      },
    );
    this.panel.open(this.player);
  }

  frame(seconds: number): void {
    this.player?.frame(seconds);
    this.panel.update();
  }

  take({ id, rows, columns, numbers }: Rows<"slice">): void {
    this.slices.get(id)?.({ rows, columns, numbers });
    this.slices.delete(id);
  }

  /** Columns of quantities over the whole log, for the plots. */
  async columns(names: string[]): Promise<{ columns: FieldList; rows: number; numbers: Float64Array } | undefined> {
    const log = this.hello?.logs?.[0];
    if (!log || names.length === 0) return undefined;
    let columns: FieldList = [];
    const slice = await this.ask(
      "log_columns",
      { log: 0, fields: names, from_s: log.t_from_s, to_s: log.t_to_s, rows: kPlotRows },
      (answer) => (columns = (answer["columns"] as FieldList | undefined) ?? []),
    );
    return slice && { columns, rows: slice.rows, numbers: slice.numbers };
  }

  // The text answer names the slice, whose numbers follow.
  private async ask(
    word: string,
    fields: Record<string, unknown>,
    answered: (answer: Answer) => void = () => {},
  ): Promise<Slice | undefined> {
    const answer = await this.app.session.request(word, fields);
    if (!answer.ok || typeof answer["slice"] !== "number") return undefined;
    answered(answer);
    return new Promise((resolve) => this.slices.set(answer["slice"] as number, resolve));
  }
}
