// Everything that a scene file is refused for: each with its line, what was expected and the nearest name.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scene/testing/test_scenes.hpp"

namespace multipanda::load_refusals_test {
namespace {

// Lines 1 to 3: two arms. What a test adds begins in line 4.
const std::string kArms =
    "arms:\n"
    "  - {name: left, base: {position_m: [0, 0.26, 0]}}\n"
    "  - {name: right, base: {position_m: [0, -0.26, 0]}}\n";
// Lines 1 to 8.
const std::string kControllets = kArms +
                                 "controllets:\n"
                                 "  - {name: a, type: solo, arms: left}\n"
                                 "  - {name: b, type: solo, arms: right}\n"
                                 "  - {name: both, type: duo, arms: [left, right]}\n"
                                 "active: [a]\n";

std::string timeline(const std::string& event) { return kControllets + "timeline:\n  - {" + event + "}\n"; }
std::string one_arm(const std::string& more) { return "arms:\n  - name: left\n    " + more + "\n"; }
std::string controllet(const std::string& more) {
  return kArms + "controllets:\n  - {name: a, type: solo, arms: left, " + more + "}\n";
}

struct Refusal {
  std::string what, text;
  int line;
  std::vector<std::string> fragments;
};
void PrintTo(const Refusal& refusal, std::ostream* out) { *out << refusal.what; }

class Refused : public testing::TestWithParam<Refusal> {};

TEST_P(Refused, NamesPlaceAndExpectation) {
  const Refusal& refusal = GetParam();
  try {
    parse(refusal.text);
    FAIL() << "was read:\n" << refusal.text;
  } catch (const ConfigError& error) {
    EXPECT_EQ(error.place().line, refusal.line) << error.what();
    if (refusal.line > 0) {
      EXPECT_THAT(error.what(), testing::StartsWith("s.yaml:" + std::to_string(refusal.line) + ": "));
    }
    for (const auto& fragment : refusal.fragments) EXPECT_THAT(error.what(), testing::HasSubstr(fragment));
  }
}

std::string many_arms(int count) {
  std::string text = "arms:\n";
  for (int i = 0; i < count; ++i) {
    text += "  - {name: a" + std::to_string(i) + ", base: {position_m: [0, " + std::to_string(i) + ", 0]}}\n";
  }
  return text;
}

const std::vector<Refusal> kFile{
    {"empty file", "", 1, {"expected a mapping with the keys", "arms", "found nothing"}},
    {"yaml syntax", "arms:\n  - {name: left\nobjects: [\n", 3, {"not readable as YAML"}},
    {"tab", "arms:\n\t- name: left\n", 2, {"YAML"}},
    {"a list", "- 1\n", 1, {"expected a mapping", "arms"}},
    {"two documents", kArms + "---\narms: []\n", 4, {"one YAML document"}},
    {"unknown key", kArms + "objcts: []\n", 4, {"unknown key 'objcts'", "did you mean 'objects'"}},
    {"far-off key", kArms + "wheels: 4\n", 4, {"unknown key 'wheels'", "valid: name, description"}},
    {"rate too fast", kArms + "ros: {rates_hz: {tf: 2000}}\n", 4, {"tf", "0 to 1000", "2000"}},
    {"rate of nothing", kArms + "ros: {rates_hz: {tfs: 10}}\n", 4, {"'tfs'", "did you mean 'tf'"}},
    {"namespace", kArms + "ros: {namespace: cell}\n", 4, {"'/cell_1'", "found 'cell'"}},
    {"namespace of digits", kArms + "ros: {namespace: /1}\n", 4, {"no digit first"}},
    {"namespace of two slashes", kArms + "ros: {namespace: /a//b}\n", 4, {"'/cell_1'"}},
    {"time of the moon", kArms + "ros: {time: moon}\n", 4, {"simulation", "system", "found 'moon'"}},
    {"doubled key", kArms + "seed: 1\nseed: 2\n", 5, {"duplicate key 'seed'", "first in line 4; remove one"}},
    {"no arms", "name: x\n", 1, {"'arms' is missing"}},
    {"empty arms", "name: x\narms: []\n", 2, {"1 to 16 arms", "found 0"}},
    {"17 arms", many_arms(17), 2, {"1 to 16 arms", "found 17"}},
    {"arms no list", "arms: left\n", 1, {"expected a list", "found 'left'"}},
    {"seed text", kArms + "seed: x\n", 4, {"a whole number", "found 'x'"}},
    {"seed fraction", kArms + "seed: 1.5\n", 4, {"a whole number"}},
    {"missing plugin", kArms + "plugins: [libnone.so]\n", 4, {"there is no file", "libnone.so"}},
};

const std::vector<Refusal> kArm{
    {"no name", "arms:\n  - {model: fer}\n", 2, {"arm 1", "'name' is missing"}},
    {"fci address", one_arm("fci: 172.16.0.300"), 3, {"an IPv4 address or a host name", "172.16.0.300"}},
    {"fci list", one_arm("fci: {address: [1]}"), 3, {"fci: address", "a string", "a list of 1"}},
    {"fci version", one_arm("fci: {version: 11}"), 3, {"'auto'", "found '11'"}},
    {"fci key", one_arm("fci: {adress: 172.16.0.2}"), 3, {"'adress'", "did you mean 'address'"}},
    {"fci twice",
     "arms:\n  - {name: a, fci: 172.16.0.2}\n  - {name: b, base: {position_m: [1, 0, 0]}, fci: {}}\n",
     3,
     {"arm 'a' has the same address 172.16.0.2"}},
    {"thresholds short",
     one_arm("collision: {torque_upper_nm: [1, 2]}"),
     3,
     {"7 numbers [N m]", "a list of 2"}},
    {"thresholds order",
     one_arm("collision: {torque_upper_nm: 10, torque_lower_nm: [1, 2, 3, 11, 5, 6, 7]}"),
     3,
     {"joint4", "torque_lower_nm at most torque_upper_nm", "11 and 10"}},
    {"sensor of nothing", one_arm("force_sensor: {range_n: 0}"), 3, {"range_n", "1 to 10000"}},
    {"counts that are none", one_arm("force_sensor: {counts_per_n: .nan}"), 3, {"counts_per_n"}},
    {"sensor that may be old", one_arm("force_sensor: {max_age_s: 1}"), 3, {"max_age_s", "0.002 to 0.03"}},
    {"a Robotiq beside the hand",
     one_arm("fci: {robotiq: /dev/ttyUSB0}"),
     3,
     {"replaces the hand", "hand: false"}},
    {"an unknown Robotiq", one_arm("fci: {robotiq_model: 3f}"), 3, {"robotiq_model", "2f-85"}},
    {"sensor without a place", one_arm("force_sensor: {address: 172.16}"), 3, {"192.168.1.1"}},
    {"two sources of forces",
     one_arm("observer_hz: 30\n    force_sensor: {range_n: 200}"),
     4,
     {"the observer", "remove 'observer_hz'"}},
    {"threshold of nothing", one_arm("collision: {wrench_upper: 0}"), 3, {"wrench_upper", "0.001 to 1000"}},
    {"acceleration order",
     one_arm("collision: {wrench_upper: 20, acceleration: {wrench_lower: 30}}"),
     3,
     {"axis 1", "30 and 20"}},
    {"bad name", "arms:\n  - {name: le ft}\n", 2, {"a letter, then"}},
    {"two names",
     "arms:\n  - {name: a}\n  - {name: a, base: {position_m: [1, 0, 0]}}\n",
     3,
     {"arm 'a'", "two arms have this name", "line 2"}},
    {"same place", "arms:\n  - name: a\n  - name: b\n", 3, {"arm 'b'", "inside arm 'a'", "0.1 m"}},
    {"unknown model", one_arm("model: ferr"), 3, {"no robot model 'ferr'", "did you mean 'fer'"}},
    {"model file", one_arm("model: none/x.yaml"), 3, {"none/x.yaml"}},
    {"wrong unit",
     one_arm("base: {position_mm: [0, 0, 0]}"),
     3,
     {"'position_mm': wrong unit", "'position_m' [m]"}},
    {"degrees in key", one_arm("base: {rpy_deg: [0, 0, 90]}"), 3, {"wrong unit", "'rpy_rad' [rad]"}},
    {"no unit", one_arm("base: {position: [0, 0, 0]}"), 3, {"a key names its unit", "'position_m' [m]"}},
    {"mistyped unit key", one_arm("base: {positon_m: [0, 0, 0]}"), 3, {"did you mean 'position_m'"}},
    {"degrees", one_arm("base: {rpy_rad: [0, 0, 90]}"), 3, {"looks like degrees", "1.570796 rad"}},
    {"two numbers", one_arm("base: {position_m: [0, 0]}"), 3, {"3 numbers [m]", "a list of 2"}},
    {"text in list", one_arm("base: {position_m: [0, 0, up]}"), 3, {"a number [m]", "found 'up'"}},
    {"unit in value", one_arm("base: {position_m: [0, 0, 1m]}"), 3, {"the key names the unit"}},
    {"decimal comma", one_arm("base: {position_m: [0, 0, '0,5']}"), 3, {"without quotes"}},
    {"nan", one_arm("base: {position_m: [0, 0, .nan]}"), 3, {"finite"}},
    {"inf", one_arm("base: {position_m: [0, 0, 1e999]}"), 3, {"finite"}},
    {"pi by zero", one_arm("base: {rpy_rad: [0, 0, pi/0]}"), 3, {"finite"}},
    {"far away", one_arm("base: {position_m: [0, 0, 1000]}"), 3, {"-100 to 100"}},
    {"both turns", one_arm("base: {rpy_rad: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}"), 3, {"found both"}},
    {"xyzw", one_arm("base: {quaternion_xyzw: [0, 0, 0, 1]}"), 3, {"'quaternion_wxyz'"}},
    {"no unit quaternion", one_arm("base: {quaternion_wxyz: [1, 1, 0, 0]}"), 3, {"unit quaternion", "1.41"}},
    {"start degrees", one_arm("start_rad: [0, -45, 0, -135, 0, 90, 45]"), 3, {"looks like degrees"}},
    {"start word", one_arm("start_rad: home"), 3, {"'ready'", "7 numbers [rad]"}},
    {"start short", one_arm("start_rad: [0, 0, 0]"), 3, {"7 numbers [rad]", "a list of 3"}},
    {"unreachable",
     one_arm("start_rad: [0, 0, 0, 0, 0, 1, 0]"),
     3,
     {"unreachable start: joint4", "-3.0718 to -0.0698"}},
    {"negative mass", one_arm("tool: {mass_kg: -1}"), 3, {"tool: mass_kg", "0 to 50", "found '-1'"}},
    {"grams", one_arm("load_present: {mass_g: 100}"), 3, {"'mass_kg' [kg]"}},
    {"payload above the rating",
     one_arm("load_declared: {mass_kg: 50}"),
     3,
     {"too heavy", "50.7126 kg", "at most 3 kg", "'largest_load_kg: 51'"}},
    {"payload above the rating, with the hand",
     one_arm("load_declared: {mass_kg: 2.3}"),
     3,
     {"hand, tool and payload are 3.0126 kg"}},
    {"tool above the rating", one_arm("tool: {mass_kg: 2.3}"), 3, {"too heavy"}},
    {"payload above the own limit",
     one_arm("largest_load_kg: 4\n    load_declared: {mass_kg: 4}"),
     4,
     {"at most 4 kg"}},
    {"no body",
     one_arm("tool: {mass_kg: 1, inertia_kg_m2: {xx: 1, yy: 1, zz: 3}}"),
     3,
     {"inertia is not physically consistent", "1, 1, 3"}},
    {"hand is yes", one_arm("hand: yes"), 3, {"true or false", "found 'yes'"}},
    {"looser torque",
     one_arm("safety: {torque_max_nm: [87, 87, 87, 90, 12, 12, 12]}"),
     3,
     {"joint4", "90 N m is looser", "87 N m", "allow_looser_limits: true"}},
    {"useless cap", one_arm("safety: {torque_max_nm: 200}"), 3, {"no joint is limited by 200"}},
    {"negative torque", one_arm("safety: {torque_max_nm: -5}"), 3, {"at least 0"}},
    {"looser position",
     one_arm("safety: {position_min_rad: [-3, -1, -1, -3, -1, 0, -1]}"),
     3,
     {"position_min_rad of joint1", "looser"}},
    {"start outside safety", one_arm("safety: {position_max_rad: 0.5}"), 3, {"unreachable start: joint6"}},
    {"no room",
     one_arm("safety: {position_min_rad: 1, position_max_rad: 0.5}"),
     3,
     {"empty position range for joint1"}},
    {"far end effector",
     one_arm("end_effector: {position_m: [0, 0, 0.62]}"),
     3,
     {"0.62 m from the flange", "at most 0.5 m", "farthest_end_effector_m: 0.7"}},
    {"half a box", one_arm("safety: {workspace_min_m: [0, 0, 0]}"), 3, {"both"}},
    {"empty box",
     one_arm("safety: {workspace_min_m: [0, 0, 0], workspace_max_m: [1, 0, 1]}"),
     3,
     {"box is empty"}},
    {"tool shape",
     one_arm("tool_shapes: [{shape: cone, diameter_m: 0.1}]"),
     3,
     {"arm 'left': tool shape 1: shape", "'box' or 'sphere'", "found 'cone'"}},
    {"tool sphere with edges",
     one_arm("tool_shapes: [{shape: sphere, size_m: [1, 1, 1]}]"),
     3,
     {"a sphere has no 'size_m'", "diameter_m"}},
    {"tool box without size", one_arm("tool_shapes: [{shape: box}]"), 3, {"a box needs 'size_m' [m]"}},
    {"tool shapes no list", one_arm("tool_shapes: {shape: box}"), 3, {"expected a list"}},
    {"tool diameter",
     one_arm("tool_shapes: [{shape: sphere, diameter_m: 0}]"),
     3,
     {"0.001 to 2", "found '0'"}},
    {"tool diameter unit",
     one_arm("tool_shapes: [{shape: sphere, diameter_mm: 40}]"),
     3,
     {"'diameter_m' [m]"}},
    {"fingers", one_arm("fingers: open"), 3, {"'locked' or 'movable'", "found 'open'"}},
    {"fingers without hand", one_arm("hand: false\n    fingers: movable"), 4, {"the arm has no hand"}},
    {"vacuum and hand", one_arm("vacuum: true"), 3, {"'hand: false'"}},
    {"known friction", one_arm("known_friction: true"), 3, {"'none' or 'model'", "found 'true'"}},
    {"rotors", "plant: {rotor_inertia_hidden: 1.5}\narms:\n  - name: left\n", 1, {"0 to 1", "1.5"}},
    {"known rotors, all hidden",
     one_arm("known_rotor_inertia: model"),
     3,
     {"no motor inertia acts", "'rotor_inertia_hidden' below 1"}},
    {"old states", one_arm("safety: {max_state_age_s: 0.01}"), 3, {"looser than the usual 0.002"}},
};

const std::vector<Refusal> kWorld{
    {"fidelity",
     kArms + "plant: {fidelity: realistc}\n",
     4,
     {"'ideal', 'realistic' or 'realistic_sensors'", "did you mean 'realistic'"}},
    {"delay", kArms + "plant: {command_delay_s: 0.0015}\n", 4, {"whole control periods"}},
    {"stiction", kArms + "plant: {stiction_nm: -0.1}\n", 4, {"0 to 5", "[N m]"}},
    {"noslip", kArms + "plant: {noslip_iterations: 2.5}\n", 4, {"a whole number"}},
    {"contact word",
     kArms + "objects:\n  - {name: o, shape: plane, contact: hard}\n",
     5,
     {"object 'o': contact", "stiffness_n_per_m"}},
    {"contact unit",
     kArms + "objects:\n  - {name: o, shape: plane, contact: {stiffness_kn_per_m: 10}}\n",
     5,
     {"'stiffness_n_per_m'"}},
    {"contact stiffness",
     kArms + "objects:\n  - {name: o, shape: plane, contact: {stiffness_n_per_m: 0}}\n",
     5,
     {"10 to 1e+06", "[N/m]"}},
    {"contact damping",
     kArms + "objects:\n  - {name: o, shape: plane, contact: {damping_ratio: -0.1}}\n",
     5,
     {"0 to 2", "found '-0.1'"}},
    {"tangential damping",
     kArms + "objects:\n  - {name: o, shape: plane, contact: {tangential_damping_n_s_per_m: 5000}}\n",
     5,
     {"1 to 2000", "[N s/m]"}},
    {"substeps", kArms + "plant: {substeps: 0}\n", 4, {"1 to 100"}},
    {"shape", kArms + "objects:\n  - {name: o, shape: bx}\n", 5, {"object 'o'", "did you mean 'box'"}},
    {"no size", kArms + "objects:\n  - {name: o, shape: box}\n", 5, {"needs 'size_m' [m]"}},
    {"wrong size",
     kArms + "objects:\n  - {name: o, shape: sphere, size_m: [1, 1, 1]}\n",
     5,
     {"a sphere has no 'size_m'", "diameter_m"}},
    {"free without mass",
     kArms + "objects:\n  - {name: o, shape: sphere, diameter_m: 0.1, fixed: false}\n",
     5,
     {"needs 'mass_kg' [kg]"}},
    {"fixed with mass",
     kArms + "objects:\n  - {name: o, shape: sphere, diameter_m: 0.1, mass_kg: 1}\n",
     5,
     {"fixed object has no mass"}},
    {"free plane", kArms + "objects:\n  - {name: o, shape: plane, fixed: false}\n", 5, {"always fixed"}},
    {"two objects",
     kArms + "objects:\n  - {name: o, shape: plane}\n  - {name: o, shape: plane}\n",
     6,
     {"two objects", "line 5"}},
};

const std::vector<Refusal> kControl{
    {"type",
     kArms + "controllets:\n  - {name: a, type: sollo, arms: left}\n",
     5,
     {"controllet 'a'", "no controllet type 'sollo'", "'solo'"}},
    {"arm",
     kArms + "controllets:\n  - {name: a, type: solo, arms: lefd}\n",
     5,
     {"there is no arm 'lefd'", "'left'"}},
    {"too few arms",
     kArms + "controllets:\n  - {name: a, type: duo, arms: left}\n",
     5,
     {"expected 2 arms", "found 1"}},
    {"nothing observed",
     kArms + "controllets:\n  - {name: a, type: watcher, arms: left}\n",
     5,
     {"the key 'observes' with 1 arm", "'watcher' reads and does not own", "found 0"}},
    {"own arm observed",
     kArms + "controllets:\n  - {name: a, type: watcher, arms: left, observes: left}\n",
     5,
     {"owns the arm 'left'", "another arm"}},
    {"unknown arm observed",
     kArms + "controllets:\n  - {name: a, type: watcher, arms: left, observes: rihgt}\n",
     5,
     {"'rihgt'", "did you mean 'right'"}},
    {"observed twice",
     kArms + "controllets:\n  - {name: a, type: watcher, arms: left, observes: [right, right]}\n",
     5,
     {"named twice"}},
    {"observed by a law that observes none",
     kArms + "controllets:\n  - {name: a, type: solo, arms: left, observes: right}\n",
     5,
     {"'solo' observes no arm; remove this key"}},
    {"arm twice", kArms + "controllets:\n  - {name: a, type: duo, arms: [left, left]}\n", 5, {"named twice"}},
    {"two controllets",
     controllet("features: []") + "  - {name: a, type: solo, arms: left}\n",
     6,
     {"two controllets", "line 5"}},
    {"hold's name",
     kArms + "controllets:\n  - {name: left_hold, type: solo, arms: left}\n",
     5,
     {"built-in hold of arm 'left'"}},
    {"feature", controllet("features: [joint_limit]"), 5, {"no feature 'joint_limit'", "'joint_limits'"}},
    {"parameter",
     controllet("parameters: {stifness_n_per_m: 1}"),
     5,
     {"no parameter 'stifness_n_per_m'", "'stiffness_n_per_m'"}},
    {"parameter unit",
     controllet("parameters: {stiffness: 1}"),
     5,
     {"with its unit it is 'stiffness_n_per_m'"}},
    {"negative stiffness",
     controllet("parameters: {stiffness_n_per_m: -1}"),
     5,
     {"0 to 5000", "[N/m]", "found '-1'"}},
    {"too stiff",
     controllet("parameters: {stiffness_n_per_m: [1, 1, 9000]}"),
     5,
     {"0 to 5000", "found '9000'"}},
    {"size", controllet("parameters: {stiffness_n_per_m: [1, 1]}"), 5, {"3 numbers [N/m]"}},
    {"parameter degrees", controllet("parameters: {angle_rad: 90}"), 5, {"looks like degrees"}},
    {"choice", controllet("parameters: {axes: wrld}"), 5, {"'world' or 'tool'", "did you mean 'world'"}},
    {"switch", controllet("parameters: {feedforward: 1}"), 5, {"'false' or 'true'"}},
    {"feature parameter", controllet("parameters: {joint_limits: {range: 0.1}}"), 5, {"'range_rad'"}},
    {"feature bounds", controllet("parameters: {joint_limits.range_rad: 3}"), 5, {"0.01 to 0.5"}},
    {"dotted feature",
     controllet("parameters: {joint_limit.range_rad: 0.1}"),
     5,
     {"no feature 'joint_limit'"}},
    {"twice",
     controllet("parameters: {joint_limits: {range_rad: 0.1}, joint_limits.range_rad: 0.1}"),
     5,
     {"duplicate parameter 'joint_limits.range_rad'"}},
    {"input", controllet("inputs: {pos: {timeout_s: 1}}"), 5, {"no input 'pos'", "'pose'"}},
    {"input key", controllet("inputs: {pose: {max_speed: 1}}"), 5, {"'max_speed_m_per_s'"}},
    {"input unit", controllet("inputs: {joints: {max_speed_m_per_s: 1}}"), 5, {"'max_speed_rad_per_s'"}},
    {"two owners",
     kArms + "controllets:\n  - {name: a, type: solo, arms: left}\n  - {name: b, type: duo, arms: [right, "
             "left]}\nactive: [a, b]\n",
     7,
     {"arm 'left' would have two owners: 'a' and 'b'"}},
    {"active", kArms + "active: [a]\n", 4, {"no controllet 'a'", "left_hold"}},
    {"active twice", kArms + "active: [left_hold, left_hold]\n", 4, {"named twice"}},
};

const std::vector<Refusal> kTimeline{
    {"at 0", timeline("at_s: 0, stop: all"), 10, {"0.001 to 86400"}},
    {"no time", timeline("stop: all"), 10, {"'at_s' is missing"}},
    {"ms", timeline("at_ms: 5, stop: all"), 10, {"wrong unit", "'at_s' [s]"}},
    {"nothing", timeline("at_s: 1"), 10, {"exactly one", "found none"}},
    {"two things", timeline("at_s: 1, stop: all, resume: all"), 10, {"stop and resume"}},
    {"place nothing",
     timeline("at_s: 1, place: {object: table, position_m: [0, 0, 0]}"),
     10,
     {"no object 'table'", "there are no objects"}},
    {"place mistyped",
     "objects:\n  - {name: table, shape: plane}\n" + timeline("at_s: 1, place: {object: tabel, position_m: "
                                                              "[0, 0, 0]}"),
     12,
     {"no object 'tabel'", "did you mean 'table'"}},
    {"place where", timeline("at_s: 1, place: {object: table}"), 10, {"'position_m' is missing"}},
    {"unknown", timeline("at_s: 1, switch: {activate: [bath]}"), 10, {"no controllet 'bath'", "'both'"}},
    {"owners", timeline("at_s: 1, switch: {activate: [a, both]}"), 10, {"two owners: 'a' and 'both'"}},
    {"on and off",
     timeline("at_s: 1, switch: {activate: [a], deactivate: [a]}"),
     10,
     {"activate and in deactivate"}},
    {"no switch", timeline("at_s: 1, switch: {}"), 10, {"switches nothing"}},
    {"arm", timeline("at_s: 1, stop: [lift]"), 10, {"no arm 'lift'", "'left'"}},
    {"parameter",
     timeline("at_s: 1, parameter: {controllet: a, name: stiffnes_n_per_m, value: 1}"),
     10,
     {"'stiffness_n_per_m'"}},
    {"value",
     timeline("at_s: 1, parameter: {controllet: a, name: stiffness_n_per_m, value: -1}"),
     10,
     {"0 to 5000"}},
    {"feature", timeline("at_s: 1, feature: {controllet: a, name: joint_limts}"), 10, {"'joint_limits'"}},
    {"input",
     timeline("at_s: 1, reference: {controllet: a, input: joint, q_rad: [0]}"),
     10,
     {"no input 'joint'", "'joints'"}},
    {"keys",
     timeline("at_s: 1, reference: {controllet: a, input: pose, q_rad: [0]}"),
     10,
     {"carries a pose", "position_m [m]"}},
    {"half a pose",
     timeline("at_s: 1, reference: {controllet: a, input: pose, position_m: [0, 0, 0]}"),
     10,
     {"and rpy_rad"}},
    {"joints",
     timeline("at_s: 1, reference: {controllet: a, input: joints, q_rad: [0, 0]}"),
     10,
     {"7 numbers [rad]"}},
    {"degrees",
     timeline(
         "at_s: 1, reference: {controllet: a, input: pose, position_m: [0, 0, 0], rpy_rad: [180, 0, 0]}"),
     10,
     {"degrees"}},
    {"still motion",
     timeline("at_s: 1, motion: {controllet: a, input: pose, period_s: 2}"),
     10,
     {"'sine' or 'rise' with 3 numbers"}},
    {"motion's size",
     timeline("at_s: 1, motion: {controllet: a, input: wrench, rise: [0, 0, 1], period_s: 2}"),
     10,
     {"6 numbers"}},
    {"motion's speed",
     timeline("at_s: 1, motion: {controllet: a, input: pose, sine: [1, 0, 0], period_s: 2}"),
     10,
     {"3.14", "allows 0.5", "longer period_s"}},
    {"motion faster than a hand may be",
     timeline("at_s: 1, motion: {controllet: a, input: pose, sine: [0.1, 0, 0], period_s: 2}"),
     10,
     {"0.314", "a hand may reach 0.25 m/s", "contact_bounds"}},
    {"motion's overtones' speed",
     timeline(
         "at_s: 1, motion: {controllet: a, input: pose, overtones: [{}, {sine: [0.2, 0, 0]}], period_s: 2}"),
     10,
     {"1.88", "allows 0.5"}},
    {"motion's overtones",
     timeline("at_s: 1, motion: {controllet: a, input: pose, overtones: [{}, {}, {}, {}, {}, {}, {}, {}], "
              "period_s: 2}"),
     10,
     {"at most 7"}},
    {"motion's ramp",
     timeline("at_s: 1, motion: {controllet: a, input: pose, sine: [0.1, 0, 0], period_s: 2, ramp_s: 3}"),
     10,
     {"at most period_s * cycles"}},
    {"idle",
     timeline("at_s: 1, reference: {controllet: b, input: gain, value: 1}"),
     10,
     {"'b' is not running at that time"}},
    {"displaced",
     kControllets + "timeline:\n  - {at_s: 2, reference: {controllet: a, input: gain, value: 1}}\n  - {at_s: "
                    "1, switch: {activate: [both]}}\n",
     10,
     {"'a' is not running"}},
    {"stopped",
     kControllets + "timeline:\n  - {at_s: 1, stop: [left]}\n  - {at_s: 2, switch: {activate: [a]}}\n",
     11,
     {"arm 'left' is stopped", "resume"}},
};

// The feature is refused if the scene does not declare the friction that it would compensate.
TEST(FrictionCompensationInAScene, NeedsAKnownFriction) {
  const Registry builtins = Registry::with_builtins();
  const auto text = [](const std::string& known, const std::string& more) {
    return "arms:\n  - {name: left" + known +
           "}\ncontrollets:\n  - {name: a, type: joint_impedance, arms: left" + more + "}\nactive: [a]\n";
  };
  const std::string feature = ", features: [friction_compensation]", known = ", known_friction: model";
  const std::string event =
      "timeline:\n  - {at_s: 1, feature: {controllet: a, name: friction_compensation}}\n";
  EXPECT_NO_THROW(parse_scene(text(known, feature), "s.yaml", builtins));
  EXPECT_NO_THROW(parse_scene(text(known, "") + event, "s.yaml", builtins));
  for (const auto& [scene, line] : {std::pair{text("", feature), 4}, std::pair{text("", "") + event, 7}}) {
    try {
      parse_scene(scene, "s.yaml", builtins);
      FAIL() << "was read:\n" << scene;
    } catch (const ConfigError& error) {
      EXPECT_EQ(error.place().line, line);
      EXPECT_THAT(error.what(), testing::HasSubstr("'left'"));
      EXPECT_THAT(error.what(), testing::HasSubstr("known_friction: model"));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(File, Refused, testing::ValuesIn(kFile));
INSTANTIATE_TEST_SUITE_P(Arm, Refused, testing::ValuesIn(kArm));
INSTANTIATE_TEST_SUITE_P(World, Refused, testing::ValuesIn(kWorld));
INSTANTIATE_TEST_SUITE_P(Control, Refused, testing::ValuesIn(kControl));
INSTANTIATE_TEST_SUITE_P(Timeline, Refused, testing::ValuesIn(kTimeline));

}  // namespace
}  // namespace multipanda::load_refusals_test
