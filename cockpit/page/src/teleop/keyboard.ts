// Jogging with keys: the hand moves while one is down. Keys are identified by position, so that other layouts
// work as well.
import { endingWith, type Holding, type Motion } from "../safety/holding.ts";
import type { Deflection } from "./jog.ts";

// [axis, sign]: axes 0 to 2 are right, away and up, 3 to 5 the rotations about them.
const kKeys: Record<string, readonly [number, number]> = {
  KeyD: [0, 1],
  KeyA: [0, -1],
  KeyW: [1, 1],
  KeyS: [1, -1],
  KeyR: [2, 1],
  KeyF: [2, -1],
  KeyI: [3, -1],
  KeyK: [3, 1],
  KeyL: [4, 1],
  KeyJ: [4, -1],
  KeyQ: [5, 1],
  KeyE: [5, -1],
};

export const kKeyHelp = "W S away and back, A D left and right, R F up and down; Q E turn, I K pitch, J L roll";

/** The deflection of all pressed keys. */
export function deflectionOf(down: Iterable<string>): Deflection {
  const sum = [0, 0, 0, 0, 0, 0];
  for (const code of down) {
    const known = kKeys[code];
    if (known) sum[known[0]]! += known[1];
  }
  const unit = (k: number) => Math.max(-1, Math.min(1, sum[k]!));
  return { linear: [unit(0), unit(1), unit(2)], angular: [unit(3), unit(4), unit(5)] };
}

export class KeyboardJog {
  enabled = false;
  private readonly down = new Set<string>();

  constructor(
    private readonly holding: Holding,
    private readonly motion: (deflection: () => Deflection) => Motion,
  ) {
    addEventListener("keydown", (event) => this.press(event));
    addEventListener("keyup", (event) => {
      if (this.down.delete(event.code) && this.down.size === 0) this.holding.letGo("keyboard");
    });
  }

  private press(event: KeyboardEvent): void {
    if (!this.enabled || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    if (!(event.code in kKeys) || isWriting(event.target)) return;
    event.preventDefault();
    this.down.add(event.code);
    if (this.holding.holds("keyboard")) return;
    const moves = this.motion(() => deflectionOf(this.down));
    const read = () => this.enabled && this.down.size > 0;
    const clear = () => this.down.clear();
    if (!this.holding.begin("keyboard", read, endingWith(moves, clear))) clear();
  }
}

function isWriting(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target instanceof HTMLInputElement) return target.type !== "checkbox" && target.type !== "radio";
  return target.isContentEditable || target instanceof HTMLSelectElement || target instanceof HTMLTextAreaElement;
}
