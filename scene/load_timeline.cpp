#include <algorithm>
#include <functional>
#include <set>

#include "common/text.hpp"
#include "core/reference/harmonic.hpp"
#include "scene/load_parts.hpp"

namespace multipanda {
namespace {

// Checks that the keys match the quantity of the input.
void check_quantity(const Archive& archive, const InputSpec& input) {
  const std::string carries = carries_text(input);
  if (archive.present(keys_of(input.quantity).keys).empty()) archive.self().refuse(carries);
  for (const QuantityKeys& other : quantity_keys()) {
    const auto present = archive.present(other.keys);
    if (other.quantity != input.quantity && !present.empty()) archive.at(present[0]).refuse(carries);
  }
}

// The timeline, read in the order of the file. Checks that depend on the running controllets follow the order
// of time: a reference to a controllet that is not running is refused here, not during a run.
class TimelineReader {
 public:
  explicit TimelineReader(SceneReader& reader)
      : reader_(reader), active_(reader.scene.active.begin(), reader.scene.active.end()) {}

  void visit_event(Archive& archive) {
    TimelineEvent event;
    archive.about("Event", "One item of the timeline: a time and exactly one event.");
    archive(Key("at_s",
                "Time since the start, above 0: `active` and the values of the controllets define what holds "
                "from 0 on.")
                .within(kArmPeriod, kLongestTime)
                .required(),
            event.at_s);
    Check check;
    const auto part = [&](const char* name, const char* doc, auto read) {
      archive.part(Key(name, doc), [&](Archive& inner) { check = (this->*read)(inner, event); });
    };
    part("switch", "Switches to other controllets.", &TimelineReader::visit_switch);
    part("parameter", "Sets a parameter.", &TimelineReader::visit_parameter);
    part("feature", "Switches a feature on or off.", &TimelineReader::visit_feature);
    part("reference", "Sets a reference.", &TimelineReader::visit_reference);
    part("motion", "Moves a reference along a sine or a circle.", &TimelineReader::visit_motion);
    part("place", "Places an object (simulation only).", &TimelineReader::visit_place);
    const auto stop = archive.names(Key("stop", "Arms that stop and hold until resumed.").one_of({"all"}));
    const auto resume = archive.names(
        Key("resume", "Arms that may move again; they are held until the next switch.").one_of({"all"}));
    if (!archive.reading()) return;
    event.place = archive.self().place();
    const std::vector<std::string> kinds{"switch", "parameter", "feature", "reference",
                                         "motion", "place",     "stop",    "resume"};
    if (const auto present = archive.present(kinds); present.size() != 1) {
      archive.self().refuse("expected exactly one of " + joined(kinds) + ", found " +
                            (present.empty() ? "none" : joined(present, " and ")));
    }
    if (archive.has("stop")) check = read_arms(archive.at("stop"), stop, true, event);
    if (archive.has("resume")) check = read_arms(archive.at("resume"), resume, false, event);
    events_.emplace_back(std::move(event), std::move(check));
  }

  // To be called once, after the last event.
  std::vector<TimelineEvent> sorted() {
    std::stable_sort(events_.begin(), events_.end(),
                     [](const auto& a, const auto& b) { return a.first.at_s < b.first.at_s; });
    std::vector<TimelineEvent> timeline;
    for (auto& [event, check] : events_) {
      if (check) check();
      timeline.push_back(std::move(event));
    }
    return timeline;
  }

 private:
  using What = TimelineEvent::What;
  using Check = std::function<void()>;

  // Null while describing.
  const InstanceConfig* visit_instance(Archive& archive, TimelineEvent& event) {
    archive(Key("controllet", "Name of the instance.").required(), event.controllet);
    return archive.reading() ? &reader_.instance(archive.at("controllet")) : nullptr;
  }

  const InstanceConfig& config(const std::string& name) const {
    for (const auto* list : {&reader_.scene.controllets, &reader_.holds}) {
      for (const auto& candidate : *list) {
        if (candidate.name == name) return candidate;
      }
    }
    throw std::logic_error("unknown controllet '" + name + "'");
  }

  void release(ArmSet arms) {
    std::erase_if(active_, [&](const auto& name) { return arms_of(config(name)).overlaps(arms); });
  }

  Check visit_switch(Archive& archive, TimelineEvent& event) {
    event.what = What::switch_controllets;
    archive.about("Switch");
    const auto activate = archive.names(
        Key("activate",
            "Controllets that run afterwards. Previous owners of their arms stop; arms without an owner are "
            "held."));
    const auto deactivate = archive.names(Key("deactivate", "Controllets that stop."));
    archive(Key("only", "`true`: all controllets that are not in `activate` stop."), event.only);
    if (!archive.reading()) return {};
    const auto starting = read_owners(reader_, activate);
    for (const InstanceConfig* started : starting) event.activate.push_back(started->name);
    for (const auto& name : deactivate) {
      const std::string& stopping = reader_.instance(name).name;
      if (std::find(event.activate.begin(), event.activate.end(), stopping) != event.activate.end())
        name.refuse(in_quotes(stopping) + " is in activate and in deactivate; remove one");
      event.deactivate.push_back(stopping);
    }
    if (event.activate.empty() && event.deactivate.empty() && !event.only) {
      archive.self().refuse(
          "switches nothing; expected 'activate' or 'deactivate' with names of controllets");
    }
    return [this, starting, place = archive.at("activate"), off = event.deactivate, only = event.only] {
      for (const InstanceConfig* started : starting) check_resumed(*started, place);
      if (only) active_.clear();
      for (const auto& name : off) active_.erase(name);
      for (const InstanceConfig* started : starting) release(arms_of(*started));
      for (const InstanceConfig* started : starting) active_.insert(started->name);
    };
  }

  void check_resumed(const InstanceConfig& started, const Node& place) const {
    const bool hold = started.name == reader_.scene.arms[started.arms[0]].name + "_hold";
    const ArmSet stopped = arms_of(started) & stopped_;
    if (stopped.empty() || hold) return;
    place.refuse("arm '" + reader_.scene.arms[stopped.first()].name +
                 "' is stopped at that time; expected a 'resume' event before '" + started.name +
                 "' controls it");
  }

  Check visit_parameter(Archive& archive, TimelineEvent& event) {
    event.what = What::set_parameter;
    archive.about("Parameter");
    const InstanceConfig* target = visit_instance(archive, event);
    archive(Key("name", "Name of the parameter; of a feature `joint_limits.range_rad`.").required(),
            event.name);
    const auto value =
        archive.open(Key("value", "As under `parameters`; approached within 0.2 s.").required());
    if (!archive.reading()) return {};
    const ParameterSpec& spec = find_parameter(reader_, *target, archive.at("name"), event.name);
    event.values = read_parameter(*value, spec_here(spec, reader_, *target), reader_.joint_count(*target));
    return {};
  }

  Check visit_feature(Archive& archive, TimelineEvent& event) {
    event.what = What::set_feature;
    archive.about("Feature");
    const InstanceConfig* target = visit_instance(archive, event);
    archive(Key("name", "Name of the feature.").required(), event.name);
    archive(Key("on", "`false`: it is switched off."), event.on);
    if (target != nullptr) check_feature(reader_, *target, archive.at("name"));
    return {};
  }

  Check visit_reference(Archive& archive, TimelineEvent& event) {
    event.what = What::set_reference;
    archive.about(
        "Reference",
        "A goal for an input of a running controllet, approached smoothly. The quantity of the input "
        "decides which keys are valid. Poses, twists and wrenches are in the world unless the input "
        "states otherwise.");
    const InputSpec* input = visit_input(archive, event);
    if (input != nullptr) check_quantity(archive, *input);
    archive(Key("duration_s",
                "Time of the approach; longer if the speed limit of the input requires it. 0: as fast as "
                "that limit allows.")
                .within(0, 3600),
            event.duration_s);
    Pose X;
    JointVector q;
    Vector3 first = Vector3::Zero(), second = Vector3::Zero();
    double value = 0;
    const std::size_t n = input == nullptr ? 0 : reader_.joint_count(config(event.controllet), input->arm);
    const auto half = [&](const char* name, const char* doc, Vector3& out) {
      archive(Key(name, doc).no_default(), out);
    };
    visit_pose(archive, X,
               Key("position_m", "Pose: position, with `rpy_rad` or `quaternion_wxyz`.").no_default());
    archive(Key("q_rad", "Joints: one angle per joint.").joints(n), q);
    half("force_n", "Wrench: force; zero if only a torque is given.", first);
    half("torque_nm", "Wrench: torque; zero if only a force is given.", second);
    half("linear_m_per_s", "Twist: velocity; zero if only an angular one is given.", first);
    half("angular_rad_per_s", "Twist: angular velocity; zero if only a linear one is given.", second);
    archive(Key("value", "Scalar: the number.").no_default(), value);
    if (!archive.reading()) return {};
    if (input->quantity == Quantity::pose) {
      if (!archive.has("position_m") || archive.present({"rpy_rad", "quaternion_wxyz"}).empty())
        archive.self().refuse("a pose needs position_m [m] and rpy_rad [rad] or quaternion_wxyz");
      const auto values = X.values();
      event.values.assign(values.begin(), values.end());
    } else if (input->quantity == Quantity::joints) {
      event.values.assign(q.begin(), q.end());
    } else if (input->quantity == Quantity::scalar) {
      event.values = {value};
    } else {
      event.values = {first.x(), first.y(), first.z(), second.x(), second.y(), second.z()};
    }
    return running_check(archive, event);
  }

  Check visit_motion(Archive& archive, TimelineEvent& event) {
    event.what = What::set_motion;
    archive.about("Motion",
                  "x(t) = x_0 + sine sin(theta) + rise (1 - cos(theta))/2, where x_0 is the set-point at the "
                  "start and theta runs from 0 to 2 pi cycles. The motion begins and ends at rest and lasts "
                  "period_s * cycles + ramp_s. A circle of radius r: `sine` is r along one axis, `rise` is 2 "
                  "r towards the center.");
    const InputSpec* input = visit_input(archive, event);
    const std::size_t count =
        input == nullptr
            ? 0
            : motion_count(input->quantity, reader_.joint_count(config(event.controllet), input->arm));
    visit_amplitudes(
        archive, count, event.sine, event.rise,
        "Pose: x, y, z [m] (it keeps its orientation). Twist, wrench: 6 numbers. Joints: one per "
        "joint [rad]. Scalar: one. Default: zero.");
    archive.items(
        Key("overtones",
            "At most 7 further harmonics: the first is twice as fast, the next three times as fast, and "
            "so on. Together they are a Fourier series per number.")
            .each("overtone"),
        [&](Archive& inner) {
          inner.about("Overtone",
                      "Adds sine sin(n theta) + rise (1 - cos(n theta))/2 to a motion, n = 2 for the "
                      "first overtone.");
          TimelineEvent::MotionPart overtone;
          visit_amplitudes(inner, count, overtone.sine, overtone.rise, "As in the motion. Default: zero.");
          if (!inner.reading()) return;
          if (event.overtones.size() == kMaxHarmonics)
            inner.self().refuse("expected at most " + std::to_string(kMaxHarmonics) + " overtones");
          event.overtones.push_back(std::move(overtone));
        });
    archive(Key("period_s", "Period of theta at full rate.").within(0.01, kLongestTime).required(),
            event.period_s);
    event.ramp_s = 0.1;
    archive(Key("cycles", "Number of periods.").within(0.1, 1e6), event.cycles);
    archive(
        Key("ramp_s", "Time in which the rate fades in and out; at most period_s * cycles.").within(0.1, 60),
        event.ramp_s);
    if (!archive.reading()) return {};
    if (archive.present({"sine", "rise", "overtones"}).empty()) {
      archive.self().refuse("moves nothing; expected 'sine' or 'rise' with " + std::to_string(count) +
                            " numbers");
    }
    if (event.ramp_s > event.period_s * event.cycles)
      archive.at("ramp_s").expected("at most period_s * cycles");
    check_speed(archive, event, *input, count);
    return running_check(archive, event);
  }

  static void visit_amplitudes(Archive& archive, std::size_t count, std::vector<double>& sine,
                               std::vector<double>& rise, const char* doc) {
    sine.assign(count, 0);
    rise.assign(count, 0);
    archive(Key("sine", doc).within(-1e4, 1e4).size(count).no_default(), sine);
    archive(Key("rise", "As `sine`. Default: zero.").within(-1e4, 1e4).size(count).no_default(), rise);
  }

  void check_speed(const Archive& archive, const TimelineEvent& event, const InputSpec& input,
                   std::size_t count) const {
    Harmonic motion{.period_s = event.period_s};
    std::copy(event.sine.begin(), event.sine.end(), motion.sine.begin());
    std::copy(event.rise.begin(), event.rise.end(), motion.rise.begin());
    for (const auto& part : event.overtones) {
      HarmonicPart& harmonic = motion.harmonics[motion.harmonic_count++];
      std::copy(part.sine.begin(), part.sine.end(), harmonic.sine.begin());
      std::copy(part.rise.begin(), part.rise.end(), harmonic.rise.begin());
    }
    double fastest = 0;
    if (input.quantity == Quantity::pose) {
      fastest = motion.top_speed(0, 3);
    } else {
      for (std::size_t i = 0; i < count; ++i) fastest = std::max(fastest, motion.top_speed(i, 1));
    }
    double allowed = input.max_speed;
    for (const auto& change : config(event.controllet).inputs) {
      if (change.name == input.name) allowed = change.max_speed;
    }
    const double hand_speed = reader_.scene.contact_bounds.hand_speed;
    if (input.quantity == Quantity::pose && hand_speed < fastest && fastest <= allowed) {
      archive.self().refuse("the motion reaches " + number_text(fastest) + " m/s, a hand may reach " +
                            number_text(hand_speed) +
                            " m/s; expected a longer period_s, or in the scene 'contact_bounds: "
                            "{hand_speed_m_per_s: " +
                            number_text(fastest) + "}', which lifts that bound");
    }
    if (fastest <= allowed) return;
    archive.self().refuse("the motion reaches " + number_text(fastest) + " per second, input '" + input.name +
                          "' allows " + number_text(allowed) +
                          "; expected a longer period_s, or a higher limit under the controllet's inputs");
  }

  // The input of an event; null while describing.
  const InputSpec* visit_input(Archive& archive, TimelineEvent& event) {
    const InstanceConfig* target = visit_instance(archive, event);
    archive(Key("input", "Name of the input.").required(), event.name);
    if (target == nullptr) return nullptr;
    const auto& inputs = reader_.registry.controllet(target->type)->descriptor.inputs;
    const auto input =
        std::find_if(inputs.begin(), inputs.end(), [&](const auto& spec) { return spec.name == event.name; });
    if (input == inputs.end())
      archive.at("input").refuse(has_no(target->type, "input", event.name, names_in(inputs)));
    return &*input;
  }

  Check running_check(const Archive& archive, const TimelineEvent& event) const {
    return [this, place = archive.at("controllet"), name = event.controllet] {
      if (!active_.contains(name)) {
        place.refuse("'" + name +
                     "' is not running at that time; add it to 'active' or switch to it earlier");
      }
    };
  }

  Check visit_place(Archive& archive, TimelineEvent& event) {
    event.what = What::place;
    archive.about(
        "Place",
        "Places an object at rest: a free one, or a fixed one (a table disappears). Only the simulation does "
        "so; real arms ignore it. If the object would penetrate another one, the run ends with an error.");
    archive(Key("object", "Name of the object.").required(), event.object);
    visit_pose(archive, event.X_WO, Key("position_m", "Center of the object in the world.").required());
    if (!archive.reading()) return {};
    std::vector<std::string> names;
    for (const auto& object : reader_.scene.objects) {
      names.push_back(object.name);
      if (object.name != event.object) continue;
      if (archive.present({"rpy_rad", "quaternion_wxyz"}).empty()) event.X_WO.rotation = object.X_WO.rotation;
      return {};
    }
    archive.at("object").refuse("there is no object " + in_quotes(event.object) +
                                name_hint(event.object, names, "there are no objects"));
  }

  Check read_arms(const Node& place, const std::vector<Node>& names, bool stop, TimelineEvent& event) {
    event.what = stop ? What::stop : What::resume;
    ArmSet arms;
    if (place.is_word({"all"})) {
      arms = ArmSet::all(reader_.scene.arms.size());
    } else {
      for (const auto& name : names) {
        arms |= ArmSet::of(reader_.arm(name));
        event.arms.push_back(name.yaml().Scalar());
      }
      if (event.arms.empty()) place.expected("'all' or a list of arms");
    }
    return [this, arms, stop] {
      if (stop) release(arms);
      stopped_ = stop ? stopped_ | arms : stopped_ - arms;
    };
  }

  SceneReader& reader_;
  std::vector<std::pair<TimelineEvent, Check>> events_;
  std::set<std::string> active_;  // without the built-in holds, unless named
  ArmSet stopped_;
};

}  // namespace

void read_timeline(Archive& archive, SceneReader& reader) {
  TimelineReader timeline(reader);
  archive.items(
      Key("timeline",
          "Events that the scene itself causes, each in an exact cycle. Events of the same time happen in "
          "the order of the file.")
          .each("event"),
      [&](Archive& inner) { timeline.visit_event(inner); });
  if (archive.reading()) reader.scene.timeline = timeline.sorted();
}

}  // namespace multipanda
