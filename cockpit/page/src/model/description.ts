// What a run says about itself: the answers to `list`, as docs/live_input.md describes them.

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
  /** Why it cannot be switched on here; empty if it can. */
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

export interface SwitchAnswer extends Answer {
  started?: string[];
  stopped?: string[];
  times_ms?: { received_to_taken: number; taken_to_first_torque: number; received_to_first_torque: number };
  torque_steps?: { arm: string; wanted_nm: number; sent_nm: number }[];
}
