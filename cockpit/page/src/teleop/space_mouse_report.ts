// Input reports of 3Dconnexion's six-axis mice over HID, as the devices send them: report 1 has the translation and, on
// newer devices, the rotation behind it; report 2 the rotation on older ones; report 3 the buttons, a bit each. All
// axes are signed 16-bit little-endian numbers of about 350 at the end.
import type { Deflection } from "./jog.ts";
import type { Vector3 } from "./vectors.ts";

export const kVendors = [0x256f, 0x046d];
const kFullScale = 350;

export interface SpaceMouseState {
  deflection: Deflection;
  buttons: number;
}

export const kAtRest: SpaceMouseState = { deflection: { linear: [0, 0, 0], angular: [0, 0, 0] }, buttons: 0 };

/** The state after one report. Reports of an unknown number or a wrong length change nothing. */
export function afterReport(state: SpaceMouseState, id: number, data: DataView): SpaceMouseState {
  if (id === 1 && data.byteLength >= 12) {
    return { ...state, deflection: { linear: axes(data, 0), angular: axes(data, 6) } };
  }
  if (id === 1 && data.byteLength >= 6) {
    return { ...state, deflection: { ...state.deflection, linear: axes(data, 0) } };
  }
  if (id === 2 && data.byteLength >= 6) {
    return { ...state, deflection: { ...state.deflection, angular: axes(data, 0) } };
  }
  if (id === 3 && data.byteLength >= 1) {
    let buttons = 0;
    for (let k = 0; k < Math.min(4, data.byteLength); ++k) buttons |= data.getUint8(k) << (8 * k);
    return { ...state, buttons: buttons >>> 0 };
  }
  return state;
}

// The device's x is right, its y towards the operator and its z down; ours are right, away and up. Both are
// right-handed, so rotations change the same way.
function axes(data: DataView, offset: number): Vector3 {
  const at = (k: number) => {
    const value = data.getInt16(offset + 2 * k, true) / kFullScale;
    return Math.max(-1, Math.min(1, value));
  };
  return [at(0), 0 - at(1), 0 - at(2)];
}
