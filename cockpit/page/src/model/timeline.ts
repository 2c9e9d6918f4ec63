// History of the arms' owners and of marked events. Fed by events, drawn by the panel.

export interface TimelineEvent {
  t_s: number;
  cycle: number;
  kind: string;
  arm: string;
  text: string;
}

export interface Span {
  from: number;
  to: number;
  owner: string;
}

export type Importance = "plain" | "notable" | "alarming";

const kAlarming = new Set(["error", "intervention", "stopped", "switch_refused"]);
const kPlain = new Set(["target_set", "contact_ended", "arm_config"]);

export function importance(kind: string): Importance {
  if (kAlarming.has(kind)) return "alarming";
  return kPlain.has(kind) ? "plain" : "notable";
}

export class Timeline {
  readonly events: TimelineEvent[] = [];
  private readonly spans = new Map<string, Span[]>();

  constructor(private readonly most = 3000) {}

  /** Events arrive in order; an earlier time starts again, as after a reset of the simulation. */
  add(event: TimelineEvent): void {
    this.events.push(event);
    if (this.events.length > this.most) this.events.splice(0, this.events.length - this.most);
  }

  /** Who owns an arm at a time. */
  own(arm: string, owner: string, t: number): void {
    let spans = this.spans.get(arm);
    if (!spans) this.spans.set(arm, (spans = []));
    let last = spans[spans.length - 1];
    if (last && t < last.to) {
      // The time went back: a reset, or a log that is scrubbed.
      spans.splice(
        0,
        spans.length,
        ...spans.filter((span) => span.from < t).map((span) => ({ ...span, to: Math.min(span.to, t) })),
      );
      last = spans[spans.length - 1];
    }
    if (last?.owner === owner) last.to = t;
    else {
      if (last) last.to = t;
      spans.push({ from: t, to: t, owner });
    }
    if (spans.length > this.most) spans.shift();
  }

  spansOf(arm: string): readonly Span[] {
    return this.spans.get(arm) ?? [];
  }

  clear(): void {
    this.events.length = 0;
    this.spans.clear();
  }
}
