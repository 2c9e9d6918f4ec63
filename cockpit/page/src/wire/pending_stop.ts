// A Stop that the run has not confirmed yet: still pending, even after the page is reloaded in the same tab.

const kKey = "multipanda.pending_stop";
const kOldest = 30_000; // an older one would surprise a person who has resumed meanwhile [ms]

export class PendingStop {
  private pressedAt: number | undefined;

  /** `run`: the token, since a later run may have the same address. */
  constructor(
    private readonly run: string,
    private readonly storage: Pick<Storage, "getItem" | "setItem" | "removeItem"> | undefined,
    private readonly now = () => Date.now(),
  ) {
    this.pressedAt = this.read();
  }

  /** Returns the time of the press, which `confirm` takes. */
  press(): number {
    this.pressedAt = this.now();
    this.write(JSON.stringify([this.run, this.pressedAt]));
    return this.pressedAt;
  }

  /** The run has taken this Stop, and all earlier ones. */
  confirm(pressedAt: number): void {
    if (this.pressedAt === undefined || this.pressedAt > pressedAt) return;
    this.pressedAt = undefined;
    this.write(undefined);
  }

  /** What to do now: the press to send again, `too old` (reported once), or nothing. */
  due(): number | "too old" | undefined {
    const pressedAt = this.pressedAt;
    if (pressedAt === undefined || this.now() - pressedAt < kOldest) return pressedAt;
    this.confirm(pressedAt);
    return "too old";
  }

  private read(): number | undefined {
    try {
      const [run, pressedAt] = JSON.parse(this.storage?.getItem(kKey) ?? "[]") as [unknown?, unknown?];
      return run === this.run && typeof pressedAt === "number" ? pressedAt : undefined;
    } catch {
      return undefined;
    }
  }

  private write(value: string | undefined): void {
    try {
      if (value === undefined) this.storage?.removeItem(kKey);
      else this.storage?.setItem(kKey, value);
    } catch {
      // Private windows may refuse to store; it is then pending while the page exists.
    }
  }
}

/** The tab's own storage, if the browser allows it. */
export function tabStorage(): Storage | undefined {
  try {
    return sessionStorage;
  } catch {
    return undefined;
  }
}
