// A Stop that the run has not confirmed: it is owed, also by the page that is loaded again in the same tab.

const kKey = "multipanda.owed_stop";
const kOldest = 30_000; // [ms]; an older one would surprise whoever has resumed meanwhile

export class OwedStop {
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

  /** The run has taken the Stop of this press, and with it all before. */
  confirm(pressedAt: number): void {
    if (this.pressedAt === undefined || this.pressedAt > pressedAt) return;
    this.pressedAt = undefined;
    this.write(undefined);
  }

  /** What to do about it now: the press to send again, `too old` (said once), or nothing. */
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
      // Private windows may refuse to store; it is owed as long as the page lives.
    }
  }
}

/** The tab's own storage, where the browser grants it. */
export function tabStorage(): Storage | undefined {
  try {
    return sessionStorage;
  } catch {
    return undefined;
  }
}
