// A recorded log: scrubbing, playback, and a second log for comparison.
import type { LogPlayer } from "../model/log_player.ts";
import { button, choice, h, newId, replaceChildren, row, setText, icon } from "../ui/dom.ts";
import { clock, spaced } from "../ui/words.ts";
import { importance } from "../model/timeline.ts";

export class LogPanel {
  readonly element = h("div", { class: "log-panel" });
  private readonly play = button("", () => this.toggle());
  private readonly scrub = h("input", { type: "range", min: 0, max: 1, step: 0.01, "aria-label": "Time in the log" });
  private readonly time = h("span", { class: "number" });
  private readonly names = h("p", { class: "hint" });
  private readonly marks = h("div", {
    class: "log-events",
    role: "region",
    tabindex: 0,
    "aria-label": "Events of the log",
  });
  private player: LogPlayer | undefined;
  private shownPlaying: boolean | undefined;

  constructor() {
    const id = newId("speed");
    const speeds = [0.1, 0.25, 0.5, 1, 2, 5, 10].map((value) => [String(value), `${value} ×`] as const);
    const speed = choice(speeds, "1", (value) => this.player && (this.player.speed = Number(value)), { id });
    this.scrub.addEventListener("input", () => {
      if (!this.player) return;
      this.player.playing = false;
      this.player.seek(Number(this.scrub.value));
    });
    this.element.append(
      row(this.play, this.time, h("label", { for: id }, "Speed"), speed, this.names),
      this.scrub,
      this.marks,
    );
  }

  open(player: LogPlayer): void {
    this.player = player;
    this.scrub.min = String(player.from);
    this.scrub.max = String(player.to);
    const [first, second] = player.logs;
    setText(this.names, second ? `${first!.name}, compared with ${second.name} (pale)` : first!.name);
    const buttons = player.logs.flatMap((log, k) =>
      log.events
        .filter((event) => importance(event.kind) !== "plain")
        .slice(0, 400)
        .map((event) => {
          const seek = () => player.seek(player.from + event.t_s - log.t_from_s);
          const text = ` ${k > 0 ? `${log.name}: ` : ""}${spaced(event.kind)} ${event.arm} ${event.text}`;
          const at = h("span", { class: "number" }, clock(event.t_s));
          return button([at, text], seek, { class: `quiet ${importance(event.kind)}` });
        }),
    );
    replaceChildren(this.marks, ...buttons);
    player.seek(player.from);
    this.update();
  }

  update(): void {
    const { player } = this;
    if (!player) return;
    setText(this.time, `${clock(player.t)} of ${clock(player.to)}`);
    if (document.activeElement !== this.scrub || player.playing) this.scrub.value = String(player.t);
    if (this.shownPlaying === player.playing) return;
    this.shownPlaying = player.playing;
    this.play.setAttribute("aria-label", player.playing ? "Pause the log" : "Play the log");
    replaceChildren(this.play, icon(player.playing ? "pause" : "play"), player.playing ? "Pause" : "Play");
  }

  private toggle(): void {
    const { player } = this;
    if (!player) return;
    if (!player.playing && player.t >= player.to) player.seek(player.from);
    player.playing = !player.playing;
    this.update();
  }
}
