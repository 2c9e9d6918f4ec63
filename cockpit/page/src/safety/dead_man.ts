// Motion only while something is held. One gate for the whole page: every control that moves an arm (a
// button, a key, a drag, a gamepad, a headset's clutch) is a grip, and only the main-thread handler that has
// just read that grip reports it as held. A page that is hidden, frozen or closed reads nothing, so it
// reports nothing, and the run holds the arms.

/** A control that an operator holds. */
export interface Grip {
  readonly name: string;
  /** Reads the button now. False ends the hold. */
  read(): boolean;
  /** Called once when the hold ends, with the cause in words. */
  released(cause: string): void;
}

/** Messages of the gate to the run. */
export interface GripLine {
  /** The operator holds: sent at once and then every `beat_ms`. */
  beat(): void;
  /** The operator has let go. */
  release(cause: string): void;
}

export interface DeadManOptions {
  /** Between two beats. The run holds after `timeout_ms` without one. */
  beat_ms: number;
  /** Gap between two reads of the buttons after which they count as released. */
  timeout_ms: number;
}

export class DeadMan {
  private readonly grips = new Map<string, Grip>();
  private lastBeat = -Infinity;
  private lastRead = -Infinity;

  constructor(
    private readonly line: GripLine,
    private readonly options: DeadManOptions = { beat_ms: 50, timeout_ms: 200 },
  ) {}

  get held(): boolean {
    return this.grips.size > 0;
  }

  holds(name: string): boolean {
    return this.grips.has(name);
  }

  /** Begins a hold, from the handler of the press. */
  press(grip: Grip, now: number): void {
    this.letGo(grip.name, "pressed again");
    this.readAll(now);
    if (!this.held) this.lastBeat = -Infinity;
    this.grips.set(grip.name, grip);
    this.lastRead = now;
    this.beatIfDue(now);
  }

  /** Ends one hold, from the handler of the release. */
  letGo(name: string, cause: string): void {
    const grip = this.grips.get(name);
    if (!grip) return;
    this.grips.delete(name);
    if (!this.held) this.line.release(cause);
    grip.released(cause);
  }

  /** Ends all holds: the page lost the focus, its tab was hidden, the connection broke. */
  letGoAll(cause: string): void {
    for (const name of [...this.grips.keys()]) this.letGo(name, cause);
  }

  /**
   * Reads every grip and beats if at least one is still held. Called by the handler of a drawn frame, which the
   * browser stops for hidden pages. After a gap (a frozen page that wakes up) no reading counts: all grips are released.
   */
  readAll(now: number): boolean {
    if (!this.held) return false;
    if (now - this.lastRead > this.options.timeout_ms) {
      this.letGoAll("the page stalled");
      return false;
    }
    for (const [name, grip] of [...this.grips]) {
      if (!grip.read()) this.letGo(name, "released");
    }
    this.lastRead = now;
    if (this.held) this.beatIfDue(now);
    return this.held;
  }

  private beatIfDue(now: number): void {
    if (now - this.lastBeat < this.options.beat_ms) return;
    this.lastBeat = now;
    this.line.beat();
  }
}
