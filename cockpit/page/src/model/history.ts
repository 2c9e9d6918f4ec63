// The recent past of plotted quantities: rings of numbers with common times.

export interface Columns {
  t: number[];
  /** One column per component. */
  values: number[][];
}

export class Ring {
  private readonly data: Float64Array;
  private next = 0;
  private filled = 0;

  /** `width` numbers per row. */
  constructor(
    readonly width: number,
    readonly rows: number,
  ) {
    this.data = new Float64Array(width * rows);
  }

  get length(): number {
    return this.filled;
  }

  push(row: ArrayLike<number>): void {
    const at = this.next * this.width;
    for (let k = 0; k < this.width; ++k) this.data[at + k] = row[k] ?? NaN;
    this.next = (this.next + 1) % this.rows;
    this.filled = Math.min(this.rows, this.filled + 1);
  }

  /** The last number of the newest row's first column; NaN without one. */
  newest(): number {
    return this.filled === 0 ? NaN : this.data[((this.next + this.rows - 1) % this.rows) * this.width]!;
  }

  clear(): void {
    this.next = this.filled = 0;
  }

  /** Columns from the oldest row to the newest. */
  columns(from = -Infinity): number[][] {
    const columns: number[][] = Array.from({ length: this.width }, () => []);
    const first = (this.next + this.rows - this.filled) % this.rows;
    for (let i = 0; i < this.filled; ++i) {
      const at = ((first + i) % this.rows) * this.width;
      if (this.data[at]! < from) continue;
      for (let k = 0; k < this.width; ++k) columns[k]!.push(this.data[at + k]!);
    }
    return columns;
  }
}

/** Rings of the quantities in use. The first column of each is the time. */
export class History {
  private readonly rings = new Map<string, { ring: Ring; users: number; until: number }>();

  constructor(private readonly rows = 12000) {}

  watch(name: string, size: number): void {
    const known = this.rings.get(name);
    if (known) ++known.users;
    else this.rings.set(name, { ring: new Ring(1 + size, this.rows), users: 1, until: -Infinity });
  }

  unwatch(name: string): void {
    const known = this.rings.get(name);
    if (known && --known.users === 0) this.rings.delete(name);
  }

  /** Rows that arrive again, because the run starts some seconds back, are not stored twice. */
  expectRepeats(): void {
    for (const known of this.rings.values()) known.until = known.ring.newest();
  }

  clear(): void {
    for (const { ring } of this.rings.values()) ring.clear();
  }

  names(): string[] {
    return [...this.rings.keys()];
  }

  /** One row of each watched quantity. A time not later than the last one starts again (a simulation's reset). */
  take(t: number, value: (name: string) => ArrayLike<number> | undefined): void {
    for (const [name, known] of this.rings) {
      const { ring } = known;
      const values = value(name);
      if (values === undefined || t <= known.until) continue;
      known.until = -Infinity;
      const last = ring.newest();
      if (t === last) continue;
      if (t < last) ring.clear();
      const row = new Float64Array(ring.width).fill(NaN);
      row[0] = t;
      for (let k = 0; k + 1 < ring.width; ++k) row[k + 1] = values[k] ?? NaN;
      ring.push(row);
    }
  }

  columns(name: string, seconds: number): Columns {
    const ring = this.rings.get(name)?.ring;
    if (!ring) return { t: [], values: [] };
    const [t = [], ...values] = ring.columns(ring.newest() - seconds);
    return { t, values };
  }
}

/** A table with a header line, for other programs. Numbers keep all digits; NaN is left empty. */
export function csv(header: readonly string[], columns: readonly (readonly (number | null | undefined)[])[]): string {
  const quoted = (name: string) => (/[",\n]/.test(name) ? `"${name.replaceAll('"', '""')}"` : name);
  const lines = [header.map(quoted).join(",")];
  const rows = columns[0]?.length ?? 0;
  for (let i = 0; i < rows; ++i) {
    lines.push(columns.map((column) => (Number.isFinite(column[i] ?? NaN) ? String(column[i]) : "")).join(","));
  }
  return lines.join("\n") + "\n";
}
