// Binary messages of the run: numbers in the order declared in the hello. Inconsistent messages are refused
// as a whole.

export type FieldList = readonly (readonly [string, number])[];

/** Positions of quantities in a row of numbers. */
export class Layout {
  private readonly fields = new Map<string, readonly [number, number]>();
  readonly total: number;

  constructor(declared: FieldList) {
    let offset = 0;
    for (const [name, count] of declared) {
      this.fields.set(name, [offset, count]);
      offset += count;
    }
    this.total = offset;
  }

  /** The numbers of a quantity; undefined if the run does not send it. */
  of(numbers: Float64Array, name: string): Float64Array | undefined {
    const field = this.fields.get(name);
    return field && numbers.subarray(field[0], field[0] + field[1]);
  }

  /** A single number; NaN if the run does not send it. */
  one(numbers: Float64Array, name: string): number {
    const field = this.fields.get(name);
    return field ? numbers[field[0]]! : NaN;
  }
}

export type BinaryMessage =
  | { kind: "state"; number: number; numbers: Float64Array }
  /** Rows of a plot, or of a slice of a log: the time, then the fields. */
  | Rows<"plot">
  | Rows<"slice">;

export interface Rows<Kind> {
  kind: Kind;
  id: number;
  rows: number;
  columns: number;
  numbers: Float64Array;
}

const kHead = 16;

/** Decodes one message; undefined if it is truncated or of an unknown kind. */
export function decode(data: ArrayBuffer): BinaryMessage | undefined {
  if (data.byteLength < kHead) return undefined;
  const view = new DataView(data);
  const [kind, id, a, b] = [0, 4, 8, 12].map((at) => view.getUint32(at, true)) as [number, number, number, number];
  if (kind === 1) {
    if (data.byteLength !== kHead + 8 * a) return undefined;
    return { kind: "state", number: id, numbers: new Float64Array(data, kHead, a) };
  }
  if (kind === 2 || kind === 3) {
    if (b === 0 || data.byteLength !== kHead + 8 * a * b) return undefined;
    const numbers = new Float64Array(data, kHead, a * b);
    const rows = { id, rows: a, columns: b, numbers };
    return kind === 2 ? { kind: "plot", ...rows } : { kind: "slice", ...rows };
  }
  return undefined;
}
