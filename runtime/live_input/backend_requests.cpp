#include "runtime/live_input/backend_requests.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <type_traits>

#include "arm_interface/arm_error.hpp"
#include "common/text.hpp"
#include "core/record/record_fields.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

namespace {

// Collects the keys of a request.
class KeyCollector {
 public:
  explicit KeyCollector(std::vector<std::string>& keys) : keys_(keys) {}
  void required(const char* key, const auto& /*value*/, RequestBound /*bound*/ = {}) {
    keys_.emplace_back(key);
  }
  void optional(const char* key, const auto& /*value*/, RequestBound /*bound*/ = {}) {
    keys_.emplace_back(key);
  }
  void pose(const Pose& /*value*/) {
    for (const auto& key : keys_of(Quantity::pose).keys) keys_.push_back(key);
  }
  void expect(bool /*condition*/, const char* /*text*/) {}

 private:
  std::vector<std::string>& keys_;
};

// Reads the fields of a request. Throws RequestRefused.
class RequestReader {
 public:
  explicit RequestReader(const JsonFields& fields) : fields_(fields) {}

  void required(const char* key, auto& value, RequestBound bound = RequestBound::any) {
    read(key, value, bound);
  }
  void optional(const char* key, auto& value, RequestBound bound = RequestBound::any) {
    if (fields_.has(key)) read(key, value, bound);
  }
  void pose(Pose& value) { value = read_pose(fields_, value.rotation); }
  void expect(bool condition, const char* text) {
    if (!condition) fields_.refuse(text);
  }

 private:
  void read(const char* key, double& value, RequestBound bound) {
    value = fields_.number(key);
    const bool ok = std::isfinite(value) && (bound == RequestBound::any || value > 0 ||
                                             (bound == RequestBound::not_negative && value == 0));
    if (ok) return;
    fields_.expected(key, bound == RequestBound::positive       ? "a number above 0"
                          : bound == RequestBound::not_negative ? "a number of 0 or more"
                                                                : "a finite number");
  }
  void read(const char* key, std::uint32_t& value, RequestBound /*bound*/) {
    constexpr double kMost = std::numeric_limits<std::uint32_t>::max();
    const double number = fields_.number(key);
    if (!(number >= 0 && number <= kMost) || number != std::floor(number))
      fields_.expected(key, "a whole number of 0 or more");
    value = static_cast<std::uint32_t>(number);
  }
  void read(const char* key, bool& value, RequestBound /*bound*/) {
    (void)fields_.at(key);
    value = fields_.boolean(key, value);
  }
  void read(const char* key, std::string& value, RequestBound /*bound*/) { value = fields_.text(key); }
  void read(const char* key, std::array<bool, 6>& values, RequestBound /*bound*/) {
    const auto& list = fields_.at(key);
    const auto is_boolean = [](const auto& item) { return item.is_boolean(); };
    if (!list.is_array() || list.size() != values.size() ||
        !std::all_of(list.begin(), list.end(), is_boolean))
      fields_.expected(key, "a list of 6 booleans: x, y, z, roll, pitch, yaw");
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = list[i].get<bool>();
  }
  void read(const char* key, JointVector& values, RequestBound /*bound*/) {
    const auto& list = fields_.at(key);
    if (!list.is_array() || list.empty() || list.size() > kMaxJoints)
      fields_.expected(key, "a list with one number per joint");
    values.resize(static_cast<Eigen::Index>(list.size()));
    std::ranges::copy(fields_.numbers(key, list.size()), values.data());
  }
  template <int N>
  void read(const char* key, Eigen::Matrix<double, N, 1>& values, RequestBound /*bound*/) {
    std::ranges::copy(fields_.numbers(key, N), values.data());
  }
  void read(const char* key, Matrix3& inertia, RequestBound /*bound*/) {
    const JsonFields section = fields_.section(key);
    section.allow({"xx", "yy", "zz", "xy", "xz", "yz"});
    const double xy = section.number("xy", 0), xz = section.number("xz", 0), yz = section.number("yz", 0);
    inertia << section.number("xx"), xy, xz, xy, section.number("yy"), yz, xz, yz, section.number("zz");
  }
  void read(const char* key, Pose& value, RequestBound /*bound*/) {
    const JsonFields section = fields_.section(key);
    section.allow(keys_of(Quantity::pose).keys);
    value = read_pose(section);
  }
  template <typename T>
  void read(const char* key, std::optional<T>& value, RequestBound bound) {
    read(key, value.emplace(), bound);
  }

  const JsonFields& fields_;
};

template <typename Request, typename... Kinds>
constexpr bool kIsOneOf = (std::is_same_v<Request, Kinds> || ...);

template <typename Request>
constexpr bool kOffered = requires {
  Request::kName;
};

// Calls `take` with a default request of every kind that the socket offers.
template <typename Group, typename Take>
void for_each_in(Take&& take) {
  [&]<std::size_t... I>(std::index_sequence<I...>) {
    (
        [&] {
          using Request = std::variant_alternative_t<I, typename Group::Variant>;
          if constexpr (kOffered<Request>) take(Group(std::in_place_index<I>), Request{});
        }(),
        ...);
  }
  (std::make_index_sequence<std::variant_size_v<typename Group::Variant>>{});
}

// A visitor of an arm's quantities (core/record/record_fields.hpp).
struct StateWriter {
  nlohmann::json state;
  nlohmann::json& at(const std::string& name) {
    constexpr std::string_view kGripper = "gripper_";
    return name.starts_with(kGripper) ? state["gripper"][name.substr(kGripper.size())] : state[name];
  }
  void one(const char* name, auto value, bool known) {
    if (known) at(name) = value;
  }
  template <class T>
  void many(const char* name, std::span<const T> values, bool known) {
    if (known) at(name) = std::vector<T>(values.begin(), values.end());
  }
};

template <typename Take>
void for_each_request(Take&& take) {
  for_each_in<ArmRequest>(take);
  for_each_in<GripperRequest>(take);
  for_each_in<WorldRequest>(take);
}

}  // namespace

std::vector<std::string> backend_request_names() {
  std::vector<std::string> names;
  for_each_request([&](const auto&, const auto& request) {
    const char* name = request.kName.name;
    if (names.empty() || names.back() != name) names.emplace_back(name);
  });
  return names;
}

BackendRequest read_backend_request(const std::string& name, const JsonFields& fields,
                                    std::vector<std::string> common_keys) {
  std::optional<BackendRequest> found;
  std::string action;
  std::vector<std::string> actions;
  for_each_request([&]<typename Group, typename Request>(const Group&, Request request) {
    if (found || name != Request::kName.name) return;
    if (Request::kName.action != nullptr) {
      action = fields.text("action");
      actions.emplace_back(Request::kName.action);
      if (action != actions.back()) return;
      common_keys.emplace_back("action");
    }
    if constexpr (!std::is_same_v<Group, WorldRequest>) common_keys.emplace_back("arm");
    KeyCollector collector(common_keys);
    request.visit(collector);
    fields.allow(common_keys);
    RequestReader reader(fields);
    request.visit(reader);
    found.emplace(Group(std::move(request)));
  });
  if (found) return std::move(*found);
  fields.refuse("there is no action '" + action.substr(0, 60) + "'" +
                name_hint(action, actions, "there is none"));
}

bool moves(const BackendRequest& request) {
  return std::visit(
      [](const auto& group) {
        return std::visit(
            []<typename Kind>(const Kind&) {
              // A new kind of request counts as moving unless it is listed here.
              return !kIsOneOf<Kind, SetFrames, SetJointStiffness, SetCartesianStiffness,
                               SetCollisionThresholds, SetGuidingMode, RecoverFromError, Reconnect,
                               StopMotion, SetUserStop, GripperStop, VacuumStop, PlaceObject, ResetSimulation,
                               PauseSimulation, StepSimulation, PushObject>;
            },
            group);
      },
      request);
}

nlohmann::json state_of(const ArmSample& sample, std::size_t joints) {
  StateWriter writer;
  visit_sample(writer, sample, joints);
  writer.state["mode"] = to_string(static_cast<ArmMode>(sample.mode));
  writer.state["error_names"] = error_list(sample.errors);
  return std::move(writer.state);
}

namespace {

std::vector<double> read_pair(const JsonFields& fields, const std::vector<std::string>& keys) {
  std::vector<double> values;
  for (const auto& key : keys) {
    const auto half = fields.has(key) ? fields.numbers(key, 3) : std::vector<double>(3, 0.0);
    values.insert(values.end(), half.begin(), half.end());
  }
  return values;
}

// x y z, w x y z, as given: the quaternion need not be normalized.
std::vector<double> pose_values(const JsonFields& fields, const std::optional<Matrix3>& rotation) {
  const int orientations = fields.has("rpy_rad") + fields.has("quaternion_wxyz");
  if (!fields.has("position_m") || orientations > 1 || (orientations == 0 && !rotation))
    fields.refuse(std::string("a pose needs ") + keys_of(Quantity::pose).expected);
  std::vector<double> values = fields.numbers("position_m", 3);
  if (fields.has("quaternion_wxyz")) {
    const auto q = fields.numbers("quaternion_wxyz", 4);
    values.insert(values.end(), q.begin(), q.end());
    return values;
  }
  Pose X;
  if (fields.has("rpy_rad")) {
    const auto a = fields.numbers("rpy_rad", 3);
    for (const double angle : a) {
      if (std::abs(angle) > 2.01 * std::numbers::pi)
        fields.expected("rpy_rad", "angles in radians, at most one turn (these look like degrees)");
    }
    X.rotation = rotation_from_rpy({a[0], a[1], a[2]});
  } else {
    X.rotation = *rotation;
  }
  const Quaternion q = X.quaternion();
  values.insert(values.end(), {q.w(), q.x(), q.y(), q.z()});
  return values;
}

}  // namespace

std::vector<std::string> reference_keys() {
  std::vector<std::string> all{"values"};
  for (const auto& row : quantity_keys()) all.insert(all.end(), row.keys.begin(), row.keys.end());
  return all;
}

Pose read_pose(const JsonFields& fields, const std::optional<Matrix3>& rotation) {
  const auto v = pose_values(fields, rotation);
  const Quaternion q(v[3], v[4], v[5], v[6]);
  if (!(std::abs(q.norm() - 1) <= 1e-2)) fields.expected("quaternion_wxyz", "a unit quaternion, w first");
  return Pose::from({v[0], v[1], v[2]}, q);
}

std::vector<double> read_reference(const JsonFields& fields, const InputSpec& input) {
  const auto& own = keys_of(input.quantity).keys;
  std::vector<std::string> found;
  for (const auto& key : reference_keys()) {
    if (fields.has(key)) found.push_back(key);
  }
  if (found == std::vector<std::string>{"values"}) return fields.numbers("values");
  const auto is_own = [&](const auto& key) { return std::ranges::find(own, key) != own.end(); };
  if (found.empty() || !std::ranges::all_of(found, is_own)) fields.refuse(carries_text(input));
  if (input.quantity == Quantity::pose) return pose_values(fields, {});
  if (own.size() == 2) return read_pair(fields, own);
  return fields.numbers(own[0]);
}

}  // namespace multipanda
