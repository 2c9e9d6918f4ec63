#include "logs/export.hpp"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include <nlohmann/json.hpp>

#include "logs/cdr.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "logs/npz.hpp"

namespace multipanda {
namespace {

// One field of a message as plain values, for tables and arrays. Nested messages become fields "outer_inner".
// Points, vectors and quaternions (x y z w) become one field of 3 or 4 numbers, times become seconds, and
// lists of strings become one string, a JSON array.
struct FlatField {
  std::string name;
  std::variant<std::vector<double>, std::vector<std::int64_t>, std::string> values;
  bool list = false;               // a sequence of any length
  std::string unit;                // as in a column's name: "rad_per_s"; empty: none
  std::vector<std::string> parts;  // names of the numbers of a point, vector or quaternion: x y z
};

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

// The message's fields in the order of its definition; nothing for an unknown message type.
// Throws std::runtime_error for a damaged message, and for a known type with another definition
// (a log of another version).
std::optional<std::vector<FlatField>> flatten(const mcap::Schema& schema, mcap::Bytes cdr) {
  std::vector<FlatField> out;
  const bool known = [&]<typename... M>(std::type_identity<std::tuple<M...>>) {
    return (flatten_as<M>(schema, cdr, out) || ...);
  }(std::type_identity<msg::OwnMessages>{});
  if (!known) return std::nullopt;
  return out;
}

using Numbers = std::vector<double>;
using Integers = std::vector<std::int64_t>;

// A field over all messages of one topic.
struct Column {
  std::string name;
  NpzWriter::Kind kind = NpzWriter::Kind::real;
  std::size_t width = 0;  // most numbers, or code points, of any message
  bool matrix = false;
  std::string unit;
  std::vector<std::string> parts;

  // The names of its cells in a table, with unit: "q_1_rad", "tool_center_x_m", "age_s".
  std::vector<std::string> cell_names() const {
    const bool told = unit.empty() || name.ends_with("_" + unit);
    const std::string ending = told ? "" : "_" + unit;
    if (!matrix) return {name + ending};
    std::vector<std::string> names;
    for (std::size_t i = 0; i < width; ++i) {
      names.push_back(name + "_" + (i < parts.size() ? parts[i] : std::to_string(i + 1)) + ending);
    }
    return names;
  }
};

struct Table {
  std::string topic;
  std::vector<Column> columns;
  std::size_t rows = 0;
  bool json = false;  // one more column: the whole message
};

bool happens_now_and_then(const std::string& type) {
  return type == "multipanda_msgs/msg/Event" || type == "multipanda_msgs/msg/Switch" ||
         type == "multipanda_msgs/msg/Intervention";
}

std::size_t width_of(const FlatField& field) {
  if (const auto* text = std::get_if<std::string>(&field.values)) return code_point_count(*text);
  if (const auto* integers = std::get_if<Integers>(&field.values)) return integers->size();
  return std::get<Numbers>(field.values).size();
}

NpzWriter::Kind kind_of(const FlatField& field) {
  static constexpr NpzWriter::Kind kKinds[] = {NpzWriter::Kind::real, NpzWriter::Kind::integer,
                                               NpzWriter::Kind::text};
  return kKinds[field.values.index()];
}

std::string as_json(const std::vector<FlatField>& fields) {
  nlohmann::ordered_json object;
  for (const FlatField& field : fields) {
    if (const auto* text = std::get_if<std::string>(&field.values)) {
      // Lists of strings are already JSON.
      object[field.name] = !text->empty() && text->front() == '['
                               ? nlohmann::ordered_json::parse(*text, nullptr, false)
                               : nlohmann::ordered_json(*text);
      if (object[field.name].is_discarded()) object[field.name] = *text;
    } else if (const auto* integers = std::get_if<Integers>(&field.values)) {
      object[field.name] =
          field.list ? nlohmann::ordered_json(*integers) : nlohmann::ordered_json(integers->at(0));
    } else {
      const Numbers& numbers = std::get<Numbers>(field.values);
      const bool one = !field.list && numbers.size() == 1;
      object[field.name] = one ? nlohmann::ordered_json(numbers[0]) : nlohmann::ordered_json(numbers);
    }
  }
  return object.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

// Reads the log once, hands each readable message to `visit(topic, schema name, fields)`, and returns the
// log's topics.
template <typename Visit>
std::string read_log(const std::filesystem::path& log, std::vector<std::string>* notes, Visit&& visit) {
  McapReader reader(log);
  std::set<std::string> unknown;
  while (const auto message = reader.next()) {
    const auto fields = flatten(*message->schema, message->data);
    if (fields) {
      visit(message->channel->topic, message->schema->name, *fields);
    } else {
      unknown.insert(message->channel->topic + " (" + message->schema->name + ")");
    }
  }
  if (notes == nullptr) return reader.topics_text();
  for (const std::string& topic : unknown) notes->push_back("not exported, unknown message type: " + topic);
  if (!reader.complete()) {
    notes->push_back(
        "the log has no footer (killed, or the disk was full); exported up to its last complete chunk");
  }
  if (reader.damaged_records() > 0) {
    notes->push_back(std::to_string(reader.damaged_records()) + " damaged records are left out");
  }
  return reader.topics_text();
}

std::map<std::string, Table> measure(const std::filesystem::path& log, ExportResult& result) {
  std::map<std::string, Table> tables;
  const std::string topics = read_log(
      log, &result.notes, [&](const std::string& topic, const std::string& type, const auto& fields) {
        Table& table = tables[topic];
        if (table.rows == 0) {
          table.topic = topic;
          table.json = happens_now_and_then(type);
          for (const FlatField& field : fields) {
            table.columns.push_back({field.name == "stamp" ? "t" : field.name, kind_of(field), 0, false,
                                     field.unit, field.parts});
          }
          if (table.json) table.columns.push_back({"json", NpzWriter::Kind::text, 0, false, {}, {}});
        }
        for (std::size_t i = 0; i < fields.size(); ++i) {
          table.columns[i].width = std::max(table.columns[i].width, width_of(fields[i]));
          table.columns[i].matrix =
              fields[i].list || (kind_of(fields[i]) != NpzWriter::Kind::text && width_of(fields[i]) > 1);
        }
        if (table.json) {
          table.columns.back().width =
              std::max(table.columns.back().width, code_point_count(as_json(fields)));
        }
        ++table.rows;
        ++result.messages;
      });
  if (tables.empty()) {
    throw std::runtime_error(log.string() + " has no message to export: expected those of a run, such as " +
                             std::string(msg::ArmState::kType) + "; its topics: " + topics);
  }
  return tables;
}

std::string without_slash(std::string_view topic) {
  return std::string(topic.substr(topic.starts_with('/') ? 1 : 0));
}

std::string csv_text(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    out += c;
    if (c == '"') out += c;
  }
  return out + "\"";
}

template <typename T>
void append_number(std::string& line, T value) {
  char text[40];
  line.append(text,
              std::to_chars(text, text + sizeof(text), value).ptr);  // shortest text that reads back exactly
}

template <typename T>
void append_cells(std::string& line, const std::vector<T>& values, std::size_t width) {
  for (std::size_t i = 0; i < width; ++i) {
    if (i > 0) line += ',';
    if (i < values.size()) append_number(line, values[i]);
  }
}

}  // namespace

ExportResult export_csv(const std::filesystem::path& log, const std::filesystem::path& directory) {
  ExportResult result;
  const auto tables = measure(log, result);
  std::filesystem::create_directories(directory);
  std::map<std::string, std::ofstream> files;
  for (const auto& [topic, table] : tables) {
    std::string name = without_slash(topic);
    std::replace(name.begin(), name.end(), '/', '_');
    const std::filesystem::path path = directory / (name + ".csv");
    std::ofstream& file = files[topic];
    file.open(path, std::ios::trunc);
    result.files.push_back(path);
    std::string line;
    for (const Column& column : table.columns) {
      if (column.name == "json") continue;  // the other columns contain the same data
      for (const std::string& cell : column.cell_names()) line += (line.empty() ? "" : ",") + cell;
    }
    file << line << '\n';
  }
  read_log(log, nullptr, [&](const std::string& topic, const std::string&, const auto& fields) {
    if (!tables.contains(topic)) return;  // the log grew after the first pass
    const Table& table = tables.at(topic);
    std::string line;
    bool first = true;
    for (std::size_t i = 0; i < fields.size(); ++i) {
      const bool several = table.columns[i].matrix;
      const std::size_t width = several ? table.columns[i].width : 1;
      if (width == 0) continue;
      if (!first) line += ',';
      first = false;
      if (const auto* text = std::get_if<std::string>(&fields[i].values)) {
        line += csv_text(*text);
      } else if (const auto* integers = std::get_if<Integers>(&fields[i].values)) {
        append_cells(line, *integers, width);
      } else {
        append_cells(line, std::get<Numbers>(fields[i].values), width);
      }
    }
    files.at(topic) << line << '\n';
  });
  for (auto& [topic, file] : files) {
    file.close();
    if (!file)
      throw std::runtime_error("cannot write the table of " + topic + " in " + directory.string() +
                               "; check that the folder is writable and the disk not full");
  }
  return result;
}

ExportResult export_npz(const std::filesystem::path& log, const std::filesystem::path& file) {
  ExportResult result;
  const auto tables = measure(log, result);
  std::vector<NpzWriter::Array> arrays;
  std::map<std::string, std::size_t> first_array;  // of a topic
  for (const auto& [topic, table] : tables) {
    first_array[topic] = arrays.size();
    for (const Column& column : table.columns) {
      arrays.push_back(
          {without_slash(topic) + "/" + column.name, column.kind, table.rows, column.width, column.matrix});
    }
  }
  NpzWriter writer(file, std::move(arrays));
  std::map<std::string, std::size_t> rows;
  read_log(log, nullptr, [&](const std::string& topic, const std::string&, const auto& fields) {
    if (!tables.contains(topic) || rows[topic]++ >= tables.at(topic).rows)
      return;  // the log grew after the first
               // pass
    std::size_t array = first_array.at(topic);
    for (const FlatField& field : fields) {
      std::visit([&](const auto& values) { writer.add(array, values); }, field.values);
      ++array;
    }
    if (tables.at(topic).json) writer.add(array, as_json(fields));
  });
  writer.close();
  result.files.push_back(file);
  return result;
}

}  // namespace multipanda
