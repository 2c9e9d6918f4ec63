// A recorded log as a run: position and playback. States are fetched ahead in slices.
import type { WireLog } from "../wire/hello.ts";

export interface Slice {
  columns: number;
  rows: number;
  /** Row by row: the time, then the numbers of a state. */
  numbers: Float64Array;
}

export type FetchStates = (log: number, from_s: number, to_s: number) => Promise<Slice | undefined>;
export type FetchState = (log: number, t_s: number) => Promise<Slice | undefined>;

const kAhead = 4; // [s] in one slice

/** One log: its slice in memory, and the one being fetched. */
class Track {
  private slice: Slice | undefined;
  private coming = false;

  constructor(
    private readonly log: number,
    private readonly info: WireLog,
    private readonly fetch: FetchStates,
  ) {}

  /** The row of a time, if available; fetches what comes next. */
  at(t: number): Float64Array | undefined {
    const time = Math.min(this.info.t_to_s, Math.max(this.info.t_from_s, t));
    const row = this.slice && rowAt(this.slice, time);
    const end = this.slice ? this.slice.numbers[(this.slice.rows - 1) * this.slice.columns]! : -Infinity;
    if (!this.coming && (row === undefined || (end - time < kAhead / 2 && end < this.info.t_to_s - 1e-3))) {
      this.coming = true;
      void this.fetch(this.log, time, Math.min(this.info.t_to_s, time + kAhead)).then((slice) => {
        this.coming = false;
        if (slice && slice.rows > 0) this.slice = slice;
      });
    }
    return row;
  }
}

/** The newest row not later than `t`; undefined if it is outside the slice. */
export function rowAt({ rows, columns, numbers }: Slice, t: number): Float64Array | undefined {
  const time = (k: number) => numbers[k * columns]!;
  const kClose = 0.05; // [s] by which a time may be outside of a slice, whose rows do not begin exactly at its start
  if (rows === 0 || t < time(0) - kClose || t > time(rows - 1) + kClose) return undefined;
  let [low, high] = [0, rows - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time(middle) <= t) low = middle;
    else high = middle - 1;
  }
  return numbers.subarray(low * columns + 1, (low + 1) * columns);
}

export class LogPlayer {
  t: number;
  playing = false;
  speed = 1;
  readonly from: number;
  readonly to: number;
  private readonly tracks: Track[];
  private scrubbing = 0;
  private readonly shown: (number | undefined)[] = [];

  /** The time of a second log counts from its own start, like the first one's. */
  constructor(
    readonly logs: readonly WireLog[],
    fetchStates: FetchStates,
    private readonly fetchState: FetchState,
    private readonly show: (log: number, numbers: Float64Array) => void,
  ) {
    this.from = logs[0]!.t_from_s;
    this.to = Math.max(...logs.map((log) => this.from + log.t_to_s - log.t_from_s));
    this.t = this.from;
    this.tracks = logs.map((log, k) => new Track(k, log, fetchStates));
  }

  seek(t: number): void {
    this.t = Math.min(this.to, Math.max(this.from, t));
    const latest = ++this.scrubbing;
    this.logs.forEach((_, log) => {
      void this.fetchState(log, this.timeIn(log)).then((slice) => {
        // An older answer that arrives later is not shown.
        if (slice && slice.rows > 0 && latest === this.scrubbing)
          this.show(log, slice.numbers.subarray(1, slice.columns));
      });
    });
  }

  /** Advances with the drawn frames. */
  frame(seconds: number): void {
    if (!this.playing) return;
    const next = Math.min(this.to, this.t + seconds * this.speed);
    let waiting = false;
    const rows = this.tracks.map((track, log) => track.at(this.timeIn(log, next)));
    rows.forEach((row, log) => {
      if (!row) waiting = true;
      else if (this.shown[log] !== row.byteOffset) {
        this.shown[log] = row.byteOffset;
        this.show(log, row);
      }
    });
    if (waiting) return; // the clock waits for the data
    this.t = next;
    if (this.t >= this.to) this.playing = false;
  }

  private timeIn(log: number, t = this.t): number {
    return this.logs[log]!.t_from_s + (t - this.from);
  }
}
