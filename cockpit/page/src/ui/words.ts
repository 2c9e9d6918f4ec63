// Names and numbers for display.

// Unit suffixes of parameters and quantities, as in CONVENTIONS.md.
const kUnits: [string, string][] = [
  ["_n_per_m_per_s", "N/(m/s)"],
  ["_nm_per_rad_per_s", "N m s/rad"],
  ["_rad_per_s2", "rad/s²"],
  ["_m_per_s2", "m/s²"],
  ["_nm_per_rad", "N m/rad"],
  ["_nm_per_s", "N m/s"],
  ["_n_per_m", "N/m"],
  ["_n_per_s", "N/s"],
  ["_m_per_s", "m/s"],
  ["_rad_per_s", "rad/s"],
  ["_n_nm", "N, N m"],
  ["_mrad", "mrad"],
  ["_rad", "rad"],
  ["_mm", "mm"],
  ["_nm", "N m"],
  ["_kg", "kg"],
  ["_hz", "Hz"],
  ["_us", "µs"],
  ["_ms", "ms"],
  ["_m", "m"],
  ["_n", "N"],
  ["_j", "J"],
  ["_w", "W"],
  ["_s", "s"],
];

/** `stiffness_n_per_m` is `stiffness` in `N/m`. */
export function nameAndUnit(name: string): { name: string; unit: string } {
  for (const [ending, unit] of kUnits) {
    if (name.endsWith(ending)) return { name: spaced(name.slice(0, -ending.length)), unit };
  }
  return { name: spaced(name), unit: "" };
}

export const spaced = (name: string): string => name.replaceAll("_", " ");

/** With a sign only if negative, and a constant width. */
export function fixed(value: number | undefined, digits: number): string {
  if (value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
}

/** `2:03.4` for 123.4 s. */
export function clock(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  const tenths = Math.max(0, Math.floor(seconds * 10 + 1e-6));
  const minutes = Math.floor(tenths / 600);
  const rest = (tenths - minutes * 600) / 10;
  return `${minutes}:${rest.toFixed(1).padStart(4, "0")}`;
}

export function listed(names: readonly string[]): string {
  if (names.length < 2) return names[0] ?? "";
  return `${names.slice(0, -1).join(", ")} and ${names[names.length - 1]}`;
}
