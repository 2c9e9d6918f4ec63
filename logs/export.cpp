#include "logs/export.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <nlohmann/json.hpp>

#include "logs/cdr.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "logs/npz.hpp"

namespace multipanda {
namespace {

using Numbers = std::vector<double>;
using Integers = std::vector<std::int64_t>;

// One field of a message as plain values, for tables and arrays. Nested messages become fields "outer_inner".
// Points, vectors and quaternions (x y z w) become one field of 3 or 4 numbers, times become seconds, and
// lists of strings become one string, a JSON array.
struct FlatField {
  std::string name;
  std::variant<Numbers, Integers, std::string> values;
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

// The field's values as V, which keep their memory from message to message.
template <typename V>
V& values_of(FlatField& flat) {
  if (!std::holds_alternative<V>(flat.values)) flat.values.template emplace<V>();
  return std::get<V>(flat.values);
}

template <typename F>
void set_values(FlatField& flat, const F& field) {
  if constexpr (std::is_same_v<F, msg::Time>) {
    values_of<Numbers>(flat).assign(1, static_cast<double>(field.sec) + 1e-9 * field.nanosec);
  } else if constexpr (std::is_same_v<F, std::string>) {
    values_of<std::string>(flat) = field;
  } else if constexpr (std::is_same_v<F, std::vector<std::string>>) {
    values_of<std::string>(flat) = nlohmann::json(field).dump();
  } else if constexpr (std::is_floating_point_v<F>) {
    values_of<Numbers>(flat).assign(1, field);
  } else if constexpr (std::is_integral_v<F>) {
    values_of<Integers>(flat).assign(1, static_cast<std::int64_t>(field));
  } else if constexpr (kIsTuple<F>) {
    Numbers& numbers = values_of<Numbers>(flat);
    numbers.clear();
    for_each_field(field, [&](std::size_t, double value) { numbers.push_back(value); });
  } else if constexpr (std::is_floating_point_v<typename F::value_type>) {
    values_of<Numbers>(flat).assign(field.begin(), field.end());
  } else {
    values_of<Integers>(flat).assign(field.begin(), field.end());
  }
}

// Sets `out` to the message's fields in the order of its definition; the first message gives names and units.
// `units`: units of the enclosing field's quantities, in order; the fields of this message have no others.
template <typename M>
void flatten_into(const M& message, const std::string& prefix, std::string_view units,
                  std::vector<FlatField>& out, std::size_t& next) {
  for_each_field(message, [&]<typename F>(std::size_t i, const F& field) {
    if constexpr (RosMessage<F> && !kIsTuple<F> && !std::is_same_v<F, msg::Time>) {
      flatten_into(field, prefix + std::string(M::kFields[i]) + "_", M::kUnits[i], out, next);
    } else {
      if (next == out.size()) {
        FlatField& flat = out.emplace_back();
        flat.name = prefix + std::string(M::kFields[i]);
        flat.list = IsSequence<F>::value && !std::is_same_v<F, std::vector<std::string>>;
        if constexpr (std::is_same_v<F, msg::Time>) flat.unit = "s";
        if constexpr (kIsTuple<F>) flat.parts.assign(F::kFields.begin(), F::kFields.end());
        if (flat.unit.empty()) flat.unit = M::kUnits[i].empty() ? take_unit(units) : M::kUnits[i];
      }
      set_values(out[next++], field);
    }
  });
}

struct Table;

// The source of a table. Messages of a controllet's outputs have a topic for each output.
struct Topic {
  std::string name;
  std::string type;
  std::vector<FlatField> fields;  // of the latest message
  Table* table = nullptr;         // for the visitor
};

// One output in one cycle, as a message of its own.
struct OutputRow {
  static constexpr std::array<std::string_view, 3> kFields{"stamp", "cycle", "values"};
  static constexpr std::array<std::string_view, 3> kUnits{};
  const msg::Time& stamp;
  const std::uint64_t& cycle;
  const std::vector<double>& values;
  auto fields() const { return std::tie(stamp, cycle, values); }
};

// Takes apart the messages of one channel.
class Flattener {
 public:
  virtual ~Flattener() = default;
  // Throws std::runtime_error for a damaged message.
  virtual void visit(mcap::Bytes cdr, const std::function<void(Topic&)>& visitor) = 0;
};

template <typename M>
class FlattenerOf : public Flattener {
 public:
  explicit FlattenerOf(std::string name) : topic_{std::move(name), std::string(M::kType), {}, nullptr} {}

  void visit(mcap::Bytes cdr, const std::function<void(Topic&)>& visitor) override {
    CdrReader(cdr).read(message_);
    if constexpr (std::is_same_v<M, msg::ControlletOutputs>) {
      for (const auto& output : message_.outputs) {
        Topic& topic = outputs_[output.name];
        if (topic.name.empty()) topic.name = topic_.name + "/" + output.name;
        flatten(OutputRow{message_.stamp, message_.cycle, output.values}, topic, visitor);
      }
    } else {
      flatten(message_, topic_, visitor);
    }
  }

 private:
  void flatten(const auto& message, Topic& topic, const std::function<void(Topic&)>& visitor) {
    std::size_t next = 0;
    flatten_into(message, "", {}, topic.fields, next);
    visitor(topic);
  }

  M message_;
  Topic topic_;
  std::map<std::string, Topic> outputs_;  // by name
};

// None for an unknown message type. Throws std::runtime_error for a known type with another definition (a log
// of another version).
std::unique_ptr<Flattener> make_flattener(const mcap::Schema& schema, const std::string& topic) {
  std::unique_ptr<Flattener> made;
  [&]<typename... M>(std::type_identity<std::tuple<M...>>) {
    (void)((holds<M>(schema) && (made = std::make_unique<FlattenerOf<M>>(topic))) || ...);
  }(std::type_identity<msg::OwnMessages>{});
  return made;
}

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
  bool json = false;            // one more column: the whole message
  std::size_t first_array = 0;  // of an archive
  std::size_t done = 0;         // rows that are exported
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

// Reads the log once, hands each topic of each readable message to `visit`, and returns the log's topics.
std::string read_log(const std::filesystem::path& log, std::vector<std::string>* notes,
                     const std::function<void(Topic&)>& visit) {
  McapReader reader(log);
  std::set<std::string> unknown;
  std::map<const mcap::Channel*, std::unique_ptr<Flattener>> flatteners;
  while (const auto message = reader.next()) {
    const auto [found, first] = flatteners.try_emplace(message->channel);
    if (first) found->second = make_flattener(*message->schema, message->channel->topic);
    if (found->second) {
      found->second->visit(message->data, visit);
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
  const std::string topics = read_log(log, &result.notes, [&](Topic& topic) {
    const auto& fields = topic.fields;
    if (topic.table == nullptr) topic.table = &tables[topic.name];
    Table& table = *topic.table;
    if (table.rows == 0) {
      table.topic = topic.name;
      table.json = happens_now_and_then(topic.type);
      for (const FlatField& field : fields) {
        table.columns.push_back(
            {field.name == "stamp" ? "t" : field.name, kind_of(field), 0, false, field.unit, field.parts});
      }
      if (table.json) table.columns.push_back({"json", NpzWriter::Kind::text, 0, false, {}, {}});
    }
    for (std::size_t i = 0; i < fields.size(); ++i) {
      table.columns[i].width = std::max(table.columns[i].width, width_of(fields[i]));
      table.columns[i].matrix =
          fields[i].list || (kind_of(fields[i]) != NpzWriter::Kind::text && width_of(fields[i]) > 1);
    }
    if (table.json) {
      table.columns.back().width = std::max(table.columns.back().width, code_point_count(as_json(fields)));
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

// The topic's table with a row for this message; none: the log grew after it was measured.
Table* table_with_row(std::map<std::string, Table>& tables, Topic& topic) {
  if (topic.table == nullptr) {
    const auto found = tables.find(topic.name);
    if (found == tables.end()) return nullptr;
    topic.table = &found->second;
  }
  return topic.table->done++ < topic.table->rows ? topic.table : nullptr;
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
  auto tables = measure(log, result);
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
  read_log(log, nullptr, [&](Topic& topic) {
    if (table_with_row(tables, topic) == nullptr) return;
    const Table& table = *topic.table;
    const auto& fields = topic.fields;
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
    files.at(topic.name) << line << '\n';
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
  auto tables = measure(log, result);
  std::vector<NpzWriter::Array> arrays;
  for (auto& [topic, table] : tables) {
    table.first_array = arrays.size();
    for (const Column& column : table.columns) {
      arrays.push_back(
          {without_slash(topic) + "/" + column.name, column.kind, table.rows, column.width, column.matrix});
    }
  }
  NpzWriter writer(file, std::move(arrays));
  read_log(log, nullptr, [&](Topic& topic) {
    if (table_with_row(tables, topic) == nullptr) return;
    std::size_t array = topic.table->first_array;
    for (const FlatField& field : topic.fields) {
      std::visit([&](const auto& values) { writer.add(array, values); }, field.values);
      ++array;
    }
    if (topic.table->json) writer.add(array, as_json(topic.fields));
  });
  writer.close();
  result.files.push_back(file);
  return result;
}

}  // namespace multipanda
