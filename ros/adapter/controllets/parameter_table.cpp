#include <algorithm>
#include <cmath>
#include <rcl_interfaces/msg/floating_point_range.hpp>
#include <rcl_interfaces/msg/parameter_type.hpp>

#include <fmt/format.h>

#include "common/text.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {
namespace {

using Type = rcl_interfaces::msg::ParameterType;

bool is_switch(const ParameterSpec& spec) {
  return spec.choices == std::vector<std::string>{"false", "true"};
}

std::uint8_t type_of(const ParameterSpec& spec, std::size_t size) {
  if (is_switch(spec)) return Type::PARAMETER_BOOL;
  if (!spec.choices.empty()) return Type::PARAMETER_STRING;
  return size == 1 && spec.size == 1 ? Type::PARAMETER_DOUBLE : Type::PARAMETER_DOUBLE_ARRAY;
}

std::string type_text(std::uint8_t type) {
  switch (type) {
    case Type::PARAMETER_NOT_SET:
      return "nothing";
    case Type::PARAMETER_BOOL:
      return "a bool";
    case Type::PARAMETER_INTEGER:
      return "an integer";
    case Type::PARAMETER_DOUBLE:
      return "a number";
    case Type::PARAMETER_STRING:
      return "a string";
    default:
      return "an array of another type";
  }
}

std::size_t dots(std::string_view name) {
  return static_cast<std::size_t>(std::count(name.begin(), name.end(), '.'));
}

}  // namespace

std::optional<ParameterTable::Place> ParameterTable::find(std::string_view name) const {
  const std::size_t dot = name.find('.');
  if (dot == std::string_view::npos) return {};
  const InstanceIndex i = modes_->find(name.substr(0, dot));
  if (i == kNoInstance) return {};
  const Instance& instance = modes_->instance(i);
  const std::size_t index = instance.find_parameter(name.substr(dot + 1));
  if (index == instance.parameter_count()) return {};
  return Place{i, index};
}

std::string ParameterTable::name_of(const Place& place) const {
  const Instance& instance = modes_->instance(place.instance);
  return instance.name() + "." + instance.parameter_names()[place.index];
}

std::vector<std::string> ParameterTable::names() const {
  std::vector<std::string> names;
  for (InstanceIndex i = 0; i < modes_->instance_count(); ++i) {
    for (std::size_t k = 0; k < modes_->instance(i).parameter_count(); ++k) names.push_back(name_of({i, k}));
  }
  return names;
}

ParameterTable::Descriptor ParameterTable::describe(const std::string& name) const {
  Descriptor descriptor;
  descriptor.name = name;
  const auto place = find(name);
  if (!place) return descriptor;
  const Instance& instance = modes_->instance(place->instance);
  const ParameterSpec& spec = instance.parameter_spec(place->index);
  const std::size_t size = instance.parameter_size(place->index);
  descriptor.type = type_of(spec, size);
  descriptor.description = spec.doc;
  if (!spec.choices.empty()) {
    if (!is_switch(spec)) descriptor.additional_constraints = "one of: " + joined(spec.choices);
    return descriptor;
  }
  std::string& more = descriptor.additional_constraints;
  if (!spec.unit.empty()) more = "unit: " + spec.unit;
  if (descriptor.type == Type::PARAMETER_DOUBLE_ARRAY) {
    more +=
        fmt::format("{}{} numbers{}, each {:g} to {:g}; one number sets all", more.empty() ? "" : "; ", size,
                    spec.size == ParameterSpec::kPerJoint ? ", one per joint" : "", spec.min, spec.max);
  }
  descriptor.floating_point_range.resize(1);
  descriptor.floating_point_range[0].from_value = spec.min;
  descriptor.floating_point_range[0].to_value = spec.max;
  return descriptor;
}

ParameterTable::Value ParameterTable::get(const std::string& name) const {
  const auto place = find(name);
  if (!place) return Value();
  return value_of(*place, modes_->instance(place->instance).parameter(place->index));
}

ParameterTable::Value ParameterTable::value_of(const Place& place, const std::vector<double>& numbers) const {
  const Instance& instance = modes_->instance(place.instance);
  const ParameterSpec& spec = instance.parameter_spec(place.index);
  Value value;
  value.type = type_of(spec, instance.parameter_size(place.index));
  if (value.type == Type::PARAMETER_BOOL) {
    value.bool_value = numbers[0] > 0.5;
  } else if (value.type == Type::PARAMETER_STRING) {
    value.string_value = spec.choices.at(static_cast<std::size_t>(std::lround(numbers[0])));
  } else if (value.type == Type::PARAMETER_DOUBLE) {
    value.double_value = numbers[0];
  } else {
    value.double_array_value = numbers;
  }
  return value;
}

rcl_interfaces::msg::ListParametersResult ParameterTable::list(const std::vector<std::string>& prefixes,
                                                               std::uint64_t depth) const {
  rcl_interfaces::msg::ListParametersResult result;
  const auto matches = [&](const std::string& name) {
    if (prefixes.empty()) return depth == 0 || dots(name) < depth;
    return std::any_of(prefixes.begin(), prefixes.end(), [&](const std::string& prefix) {
      if (name == prefix) return true;
      if (!name.starts_with(prefix + ".")) return false;
      return depth == 0 || dots(std::string_view(name).substr(prefix.size() + 1)) < depth;
    });
  };
  for (auto& name : names()) {
    if (!matches(name)) continue;
    const std::string prefix = name.substr(0, name.rfind('.'));
    if (std::find(result.prefixes.begin(), result.prefixes.end(), prefix) == result.prefixes.end())
      result.prefixes.push_back(prefix);
    result.names.push_back(std::move(name));
  }
  return result;
}

std::optional<std::vector<double>> ParameterTable::numbers_in(const Value& value, const Place& place,
                                                              std::string& reason) const {
  const Instance& instance = modes_->instance(place.instance);
  const ParameterSpec& spec = instance.parameter_spec(place.index);
  const std::size_t size = instance.parameter_size(place.index);
  const std::string name = fmt::format("'{}'", name_of(place));
  if (!spec.choices.empty()) {
    const std::string word =
        value.type == Type::PARAMETER_BOOL ? (value.bool_value ? "true" : "false") : value.string_value;
    const auto choice = std::find(spec.choices.begin(), spec.choices.end(), word);
    const auto count = static_cast<std::int64_t>(spec.choices.size());
    if (value.type == Type::PARAMETER_INTEGER && value.integer_value >= 0 && value.integer_value < count)
      return std::vector{static_cast<double>(value.integer_value)};
    if (choice != spec.choices.end()) return std::vector{static_cast<double>(choice - spec.choices.begin())};
    reason = name + ": expected " + joined(spec.choices, " or ");
    return {};
  }
  switch (value.type) {
    case Type::PARAMETER_DOUBLE:
      return std::vector(size, value.double_value);
    case Type::PARAMETER_INTEGER:
      return std::vector(size, static_cast<double>(value.integer_value));
    case Type::PARAMETER_DOUBLE_ARRAY:
      return std::vector<double>(value.double_array_value.begin(), value.double_array_value.end());
    case Type::PARAMETER_INTEGER_ARRAY:
      return std::vector<double>(value.integer_array_value.begin(), value.integer_array_value.end());
    default:
      break;
  }
  reason = name + ": expected " + (size == 1 ? "a number" : fmt::format("{} numbers", size)) + ", found " +
           type_text(value.type);
  return {};
}

std::optional<Request> ParameterTable::request(const rcl_interfaces::msg::Parameter& parameter,
                                               std::string& reason) const {
  const std::string& name = parameter.name;
  const auto place = find(name);
  if (!place) {
    const std::size_t dot = name.find('.');
    const InstanceIndex i = modes_->find(std::string_view(name).substr(0, dot));
    if (i == kNoInstance || dot == std::string::npos) {
      reason =
          "there is no parameter '" + name.substr(0, 60) + "'" + name_hint(name, names(), "there are none");
      if (reason.size() > 300) reason = "there is no parameter '" + name.substr(0, 60) + "'";
    } else {
      reason = no_such_parameter(modes_->instance(i), name.substr(dot + 1));
    }
    return {};
  }
  const auto numbers = numbers_in(parameter.value, *place, reason);
  if (!numbers) return {};
  const Instance& instance = modes_->instance(place->instance);
  if (numbers->size() != instance.parameter_size(place->index)) {
    reason = fmt::format("'{}': {} numbers; expected {}", name, numbers->size(),
                         instance.parameter_size(place->index));
    return {};
  }
  Request request{.kind = Request::Kind::set_parameter};
  request.instance = place->instance;
  request.index = static_cast<std::uint16_t>(place->index);
  request.size = static_cast<std::uint8_t>(numbers->size());
  std::copy(numbers->begin(), numbers->end(), request.values.begin());
  if (const Verdict verdict = modes_->check(request); verdict != Verdict::accepted) {
    reason = multipanda::reason(*modes_, request, verdict);
    return {};
  }
  return request;
}

rcl_interfaces::msg::Parameter ParameterTable::changed(const Event& event) const {
  const Place place{event.instance, event.index};
  rcl_interfaces::msg::Parameter parameter;
  parameter.name = name_of(place);
  parameter.value = value_of(place, {event.values.begin(), event.values.begin() + event.size});
  return parameter;
}

}  // namespace multipanda::ros
