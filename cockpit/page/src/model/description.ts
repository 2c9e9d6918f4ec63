// A run's description of itself: answers to `list`, as in docs/live_input.md.

export interface InputInfo {
  name: string;
  quantity: "pose" | "twist" | "wrench" | "joints" | "scalar";
  values: number;
  frame: string;
  arm: string;
  timeout_s: number;
  doc: string;
}

export interface ParameterInfo {
  name: string;
  value: number[] | string;
  /** A change may move an arm, so it needs a hold. */
  moves?: boolean;
  doc: string;
  unit?: string;
  min?: number;
  max?: number;
  choices?: string[];
}

export interface FeatureInfo {
  name: string;
  on: boolean;
  doc?: string;
  /** Why it cannot be switched on here; empty: it can. */
  refusal?: string;
}

export interface ControlletInfo {
  name: string;
  type: string;
  arms: string[];
  active: boolean;
  inputs: InputInfo[];
  parameters: ParameterInfo[];
  features: FeatureInfo[];
}

/** The answer to any request; `ok` false has a verdict and a reason. */
export interface Answer {
  ok: boolean;
  verdict?: string;
  reason?: string;
  [key: string]: unknown;
}

/** Outcome of a request as text. */
export const outcome = (answer: Answer, done: string): string =>
  answer.ok ? done : `Refused: ${answer.reason ?? answer.verdict}`;

export interface SwitchAnswer extends Answer {
  started?: string[];
  stopped?: string[];
  times_ms?: { received_to_taken: number; taken_to_first_torque: number; received_to_first_torque: number };
  torque_steps?: { arm: string; computed_nm: number; sent_nm: number }[];
}
