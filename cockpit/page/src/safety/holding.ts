// Binds the dead-man gate to the page: events that press and release, and the motion in between.
import { DeadMan, type GripLine } from "./dead_man.ts";

/** The motion while a grip is held. */
export interface Motion {
  /** Before the first sample; returns a sentence if the motion is impossible. */
  begin(): string | undefined;
  /** One sample, sent after the beat; returns the reason if the motion must end, which ends the hold. */
  step(seconds: number): string | undefined;
  end(): void;
}

/** The same motion, which ends with `ended`, too. */
export const endingWith = (motion: Motion, ended: () => void): Motion => ({
  begin: () => motion.begin(),
  step: (seconds) => motion.step(seconds),
  end: () => {
    ended();
    motion.end();
  },
});

export class Holding {
  private readonly gate: DeadMan;
  private readonly motions = new Map<string, Motion>();
  private last = 0;

  /** `refuse` shows why a hold did not begin, or ended without a release. */
  constructor(
    line: GripLine,
    private readonly refuse: (why: string) => void,
  ) {
    this.gate = new DeadMan(line);
    const release = (cause: string) => () => this.letGoAll(cause);
    addEventListener("blur", release("the window lost the focus"));
    addEventListener("pagehide", release("the page was left"));
    addEventListener("gamepaddisconnected", release("the gamepad was disconnected"));
    document.addEventListener("freeze", release("the page was frozen"));
    // While this key is down, macOS reports no release of other keys: they would seem to be held forever.
    addEventListener("keydown", (event) => event.metaKey && this.letGoAll("the command key was pressed"), {
      capture: true,
    });
    document.addEventListener("visibilitychange", () => {
      if (document.visibilityState !== "visible") this.letGoAll("the tab was hidden");
    });
  }

  get held(): boolean {
    return this.gate.held;
  }

  holds(name: string): boolean {
    return this.gate.holds(name);
  }

  /** Begins a hold; `read` reads the button in every frame. */
  begin(name: string, read: () => boolean, motion: Motion): boolean {
    if (this.motions.has(name)) this.letGo(name, "pressed again");
    const why = motion.begin();
    if (why !== undefined) {
      this.refuse(why);
      return false;
    }
    const now = performance.now();
    this.motions.set(name, motion);
    const reads = () => document.visibilityState === "visible" && read();
    this.gate.press(
      {
        name,
        read: reads,
        released: (cause) => {
          this.motions.delete(name);
          motion.end();
          if (cause !== "released") this.refuse(`Let go: ${cause.replace(/\.$/, "")}.`);
        },
      },
      now,
    );
    return true;
  }

  letGo(name: string, cause = "released"): void {
    this.gate.letGo(name, cause);
  }

  letGoAll(cause: string): void {
    this.gate.letGoAll(cause);
  }

  /** Called in every drawn frame: reads the buttons, sends beats, and advances the motions. */
  frame(now: number): void {
    const seconds = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    if (!this.gate.readAll(now)) return;
    for (const [name, motion] of [...this.motions]) {
      const why = this.gate.holds(name) ? motion.step(seconds) : undefined;
      if (why !== undefined) this.letGo(name, why);
    }
  }

  /** A button for motion while a pointer, Space or Enter holds it. */
  bindButton(button: HTMLElement, name: string, motion: Motion): void {
    let pointer: number | undefined;
    let key: string | undefined;
    const marked = endingWith(motion, () => {
      pointer = key = undefined;
      button.classList.remove("held");
    });
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || pointer !== undefined) return;
      event.preventDefault();
      button.focus();
      button.setPointerCapture(event.pointerId);
      pointer = event.pointerId;
      if (this.begin(name, () => pointer !== undefined && button.hasPointerCapture(pointer), marked)) {
        button.classList.add("held");
      } else {
        pointer = undefined;
      }
    });
    for (const [type, cause] of [
      ["pointerup", "released"],
      ["pointercancel", "the browser took the pointer"],
      ["lostpointercapture", "the pointer was lost"],
    ] as const) {
      button.addEventListener(type, (event) => {
        if (event.pointerId === pointer) this.letGo(name, cause);
      });
    }
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    button.addEventListener("keydown", (event) => {
      if ((event.key !== " " && event.key !== "Enter") || event.repeat || event.metaKey || key !== undefined) return;
      event.preventDefault();
      key = event.key;
      if (this.begin(name, () => key !== undefined && document.activeElement === button, marked)) {
        button.classList.add("held");
      } else {
        key = undefined;
      }
    });
    button.addEventListener("keyup", (event) => {
      if (event.key === key) this.letGo(name);
    });
    button.addEventListener("blur", () => {
      if (key !== undefined) this.letGo(name, "the button lost the focus");
    });
  }
}
