#include "logs/flatten.hpp"

#include <type_traits>

#include <nlohmann/json.hpp>

#include "logs/cdr.hpp"
#include "logs/messages.hpp"

namespace multipanda {
namespace {

template <typename M, typename Visitor>
void for_each_field(const M& message, Visitor&& visit) {
  std::apply(
      [&](const auto&... field) {
        std::size_t i = 0;
        (visit(std::string(M::kFields[i++]), field), ...);
      },
      message.fields());
}

template <typename T>
struct IsSequence : std::false_type {};
template <typename T>
struct IsSequence<std::vector<T>> : std::true_type {};

// All fields are float64: point, vector, quaternion.
template <typename M>
constexpr bool kIsTuple = false;
template <>
constexpr bool kIsTuple<msg::Point> = true;
template <>
constexpr bool kIsTuple<msg::Vector3> = true;
template <>
constexpr bool kIsTuple<msg::Quaternion> = true;

template <typename M>
void flatten_into(const M& message, const std::string& prefix, std::vector<FlatField>& out) {
  for_each_field(message, [&]<typename F>(const std::string& name, const F& field) {
    FlatField flat{prefix + name, {}, IsSequence<F>::value};
    if constexpr (std::is_same_v<F, msg::Time>) {
      flat.values = std::vector<double>{static_cast<double>(field.sec) + 1e-9 * field.nanosec};
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
      for_each_field(field, [&](const std::string&, double value) { numbers.push_back(value); });
      flat.values = std::move(numbers);
    } else if constexpr (RosMessage<F>) {
      flatten_into(field, prefix + name + "_", out);
      return;
    } else if constexpr (std::is_floating_point_v<typename F::value_type>) {
      flat.values = std::vector<double>(field.begin(), field.end());
    } else {
      flat.values = std::vector<std::int64_t>(field.begin(), field.end());
    }
    out.push_back(std::move(flat));
  });
}

template <typename M>
bool flatten_as(const mcap::Schema& schema, mcap::Bytes cdr, std::vector<FlatField>& out) {
  if (schema.name != M::kType) return false;
  if (schema.text != M::kText) {
    throw std::runtime_error(
        "the log defines " + schema.name +
        " otherwise than this program: read it with the version that wrote it (named in the "
        "log's metadata)");
  }
  flatten_into(from_cdr<M>(cdr), "", out);
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
