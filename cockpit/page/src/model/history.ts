// The recent past of plotted quantities: rows of numbers with common times.

export interface Columns {
  t: number[];
  /** One column per component. */
  values: number[][];
}

interface Watched {
  size: number;
  /** Each begins with its time; the oldest is first. */
  rows: number[][];
  users: number;
  until: number;
}

const newest = ({ rows }: Watched): number => rows.at(-1)?.[0] ?? NaN;

/** The quantities in use. */
export class History {
  private readonly watched = new Map<string, Watched>();

  /** Keeps `most` rows of each, or a quarter more: they are dropped many at once. */
  constructor(private readonly most = 12000) {}

  watch(name: string, size: number): void {
    const known = this.watched.get(name);
    if (known) ++known.users;
    else this.watched.set(name, { size, rows: [], users: 1, until: -Infinity });
  }

  unwatch(name: string): void {
    const known = this.watched.get(name);
    if (known && --known.users === 0) this.watched.delete(name);
  }

  /** Rows that arrive again, because the run starts some seconds back, are not stored twice. */
  expectRepeats(): void {
    for (const known of this.watched.values()) known.until = newest(known);
  }

  clear(): void {
    for (const known of this.watched.values()) known.rows = [];
  }

  names(): string[] {
    return [...this.watched.keys()];
  }

  /** One row of each watched quantity. A time not later than the last one starts again (a simulation's reset). */
  take(t: number, value: (name: string) => ArrayLike<number> | undefined): void {
    for (const [name, known] of this.watched) {
      const values = value(name);
      if (values === undefined || t <= known.until) continue;
      known.until = -Infinity;
      const last = newest(known);
      if (t === last) continue;
      if (t < last) known.rows = [];
      known.rows.push([t, ...Array.from({ length: known.size }, (_, k) => values[k] ?? NaN)]);
      if (known.rows.length > 1.25 * this.most) known.rows.splice(0, known.rows.length - this.most);
    }
  }

  columns(name: string, seconds: number): Columns {
    const known = this.watched.get(name);
    if (!known) return { t: [], values: [] };
    const from = newest(known) - seconds;
    const rows = known.rows.filter((row) => !(row[0]! < from));
    const column = (k: number) => rows.map((row) => row[k]!);
    return { t: column(0), values: Array.from({ length: known.size }, (_, k) => column(k + 1)) };
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
