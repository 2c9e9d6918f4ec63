#include "logs/flatten.hpp"

#include <algorithm>
#include <string_view>
#include <type_traits>

#include <nlohmann/json.hpp>

#include "logs/cdr.hpp"
#include "logs/messages.hpp"

namespace multipanda {
namespace {

// Calls visit(index, field) for every field.
template <typename M, typename Visitor>
void for_each_field(const M& message, Visitor&& visit) {
  std::apply(
      [&](const auto&... field) {
        std::size_t i = 0;
        (visit(i++, field), ...);
      },
      message.fields());
}

// Takes the first of several units, separated by commas.
std::string take_unit(std::string_view& units) {
  const std::size_t end = std::min(units.find(','), units.size());
  std::string unit(units.substr(0, end));
  units.remove_prefix(std::min(end + 1, units.size()));
  return unit;
}

template <typename T>
struct IsSequence : std::false_type {};
template <typename T>
struct IsSequence<std::vector<T>> : std::true_type {};

// Messages whose fields are all float64: point, vector, quaternion.
template <typename M>
constexpr bool kIsTuple = false;
template <>
constexpr bool kIsTuple<msg::Point> = true;
template <>
constexpr bool kIsTuple<msg::Vector3> = true;
template <>
constexpr bool kIsTuple<msg::Quaternion> = true;

// `units`: units of the enclosing field's quantities, in order; the fields of this message then have none.
template <typename M>
void flatten_into(const M& message, const std::string& prefix, std::string_view units,
                  std::vector<FlatField>& out) {
  for_each_field(message, [&]<typename F>(std::size_t i, const F& field) {
    FlatField flat{prefix + std::string(M::kFields[i]), {}, IsSequence<F>::value, {}, {}};
    if constexpr (RosMessage<F> && !kIsTuple<F> && !std::is_same_v<F, msg::Time>) {
      flatten_into(field, flat.name + "_", M::kUnits[i], out);
      return;
    } else if constexpr (std::is_same_v<F, msg::Time>) {
      flat.values = std::vector<double>{static_cast<double>(field.sec) + 1e-9 * field.nanosec};
      flat.unit = "s";
    } else if constexpr (std::is_same_v<F, std::string>) {
      flat.values = field;
    } else if constexpr (std::is_same_v<F, std::vector<std::string>>) {
      flat.list = false;  // one text
      flat.values = nlohmann::json(field).dump();
    } else if constexpr (std::is_floating_point_v<F>) {
      flat.values = std::vector<double>{field};
    } else if constexpr (std::is_integral_v<F>) {
      flat.values = std::vector<std::int64_t>{static_cast<std::int64_t>(field)};
    } else if constexpr (kIsTuple<F>) {
      std::vector<double> numbers;
      for_each_field(field, [&](std::size_t, double value) { numbers.push_back(value); });
      flat.values = std::move(numbers);
      flat.parts.assign(F::kFields.begin(), F::kFields.end());
    } else if constexpr (std::is_floating_point_v<typename F::value_type>) {
      flat.values = std::vector<double>(field.begin(), field.end());
    } else {
      flat.values = std::vector<std::int64_t>(field.begin(), field.end());
    }
    if (flat.unit.empty()) flat.unit = M::kUnits[i].empty() ? take_unit(units) : M::kUnits[i];
    out.push_back(std::move(flat));
  });
}

template <typename M>
bool flatten_as(const mcap::Schema& schema, mcap::Bytes cdr, std::vector<FlatField>& out) {
  if (!holds<M>(schema)) return false;
  flatten_into(from_cdr<M>(cdr), "", {}, out);
  return true;
}

}  // namespace

std::optional<std::vector<FlatField>> flatten(const mcap::Schema& schema, mcap::Bytes cdr) {
  std::vector<FlatField> out;
  const bool known = [&]<typename... M>(std::type_identity<std::tuple<M...>>) {
    return (flatten_as<M>(schema, cdr, out) || ...);
  }(std::type_identity<msg::OwnMessages>{});
  if (!known) return std::nullopt;
  return out;
}

}  // namespace multipanda
