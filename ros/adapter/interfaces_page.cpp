#include "ros/adapter/interfaces_page.hpp"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <tuple>

#include "ros/adapter/ros_adapter.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::ros {

namespace {

constexpr const char* kMark = "<!-- tables: `ninja ros_interfaces` writes what follows -->\n";

constexpr const char* kFeatures = "features";
constexpr const char* kUsualQos = "reliable, newest 10";  // stated in the handwritten part

struct Row {
  std::string group, kind, name, type, qos, rate, doc;
  auto key() const { return std::tie(group, kind, name); }
};

void replace_all(std::string& text, const std::string& what, const std::string& by) {
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + by.size()))
    text.replace(at, what.size(), by);
}

std::string without_prefix(const std::string& text, const std::string& prefix, const std::string& by) {
  return text.starts_with(prefix) ? by + text.substr(prefix.size()) : text;
}

// "left_gripper/move" -> "<arm>_gripper/move"
std::string with_arm(std::string name, const Scene& scene) {
  for (const auto& arm : scene.arms) {
    for (const char* end : {"/", "_"}) {
      const std::string with = without_prefix(name, arm.name + end, std::string("<arm>") + end);
      if (with != name) return with;
    }
  }
  return name;
}

Row row_of(const EntityInfo& entity, const std::string& node, const Scene& scene,
           const std::vector<std::string>& features) {
  Row row{"", entity.kind, entity.name, entity.type, entity.qos, entity.rate, entity.doc};
  const std::string own = without_prefix(entity.name, node + "/", "~/");
  if (own == entity.name) {
    static const std::vector<std::string> everywhere{"/tf", "/tf_static", "/clock", "/diagnostics",
                                                     "/parameter_events"};
    const bool absolute = std::find(everywhere.begin(), everywhere.end(), own) != everywhere.end();
    row.name = absolute ? own : with_arm(own.substr(1), scene);
  } else {
    row.name = own;
    for (const auto& instance : scene.controllets) {
      const std::string with = without_prefix(own, "~/" + instance.name + "/", "~/<instance>/");
      if (with == own) continue;
      row.name = with;
      row.group = instance.type;
    }
    for (const auto& arm : scene.arms) {
      const std::string with = without_prefix(own, "~/" + arm.name + "_hold/", "~/<instance>/");
      if (with == own) continue;
      row.name = with;
      row.group = "hold";
    }
  }
  // The first arm's description represents every arm.
  for (const auto& arm : scene.arms) {
    for (const char* begin : {"`", " "}) {
      for (const char* end : {"_", "/", "`"})
        replace_all(row.doc, begin + arm.name + end, begin + std::string("<arm>") + end);
    }
  }
  replace_all(row.doc, "<arm>_link0, <arm>_link0", "<arm>_link0");
  // Features publish the same quantities with every controllet.
  for (const auto& feature : features) {
    if (row.name.starts_with("~/<instance>/" + feature + "/")) row.group = kFeatures;
  }
  return row;
}

std::string cell(std::string text) {
  replace_all(text, "|", "\\|");
  return text.empty() ? " " : text;
}

// Aliases of this row: rows with the description "As <its name>."
std::vector<std::string> aliases(const std::vector<Row>& rows, const std::string& name) {
  std::vector<std::string> out;
  for (const auto& row : rows)
    if (row.doc == "As " + name + ".") out.push_back(row.name);
  return out;
}

bool is_alias(const std::vector<Row>& rows, const Row& row) {
  return std::any_of(rows.begin(), rows.end(),
                     [&](const Row& other) { return row.doc == "As " + other.name + "."; });
}

bool is_topic(const std::string& kind) { return kind == "publisher" || kind == "subscription"; }

std::string cells(const Row& row) {
  std::string out = "`" + row.name + "` | " + cell(row.type) + " | ";
  if (is_topic(row.kind)) out += cell(row.qos == kUsualQos ? "" : row.qos) + " | " + cell(row.rate) + " | ";
  return out + cell(row.doc);
}

std::string table(const std::vector<Row>& rows, const std::string& kind) {
  std::string out;
  for (const auto& row : rows) {
    if (row.kind != kind || is_alias(rows, row)) continue;
    if (out.empty()) {
      const std::string head = kind == "publisher"      ? "Published"
                               : kind == "subscription" ? "Taken"
                               : kind == "service"      ? "Services"
                                                        : "Actions";
      out = "\n**" + head + "**\n\n";
      out += is_topic(kind) ? "| topic | type | QoS | rate | what |\n|---|---|---|---|---|\n"
                            : "| name | type | what |\n|---|---|---|\n";
    }
    out += "| " + cells(row);
    for (const auto& alias : aliases(rows, row.name)) out += " Also `" + alias + "`.";
    out += " |\n";
  }
  return out;
}

// The rows of a controllet type or of the features: outputs of one type in one row; inputs without the
// additional topics of every input, which the page names once.
std::vector<Row> condensed(const std::vector<Row>& rows) {
  std::vector<Row> out;
  for (Row row : rows) {
    if (row.name.ends_with("/goal") || row.name.ends_with("/reference")) continue;
    const auto same = std::find_if(out.begin(), out.end(), [&](const Row& other) {
      return row.kind == "publisher" && std::tie(other.kind, other.type, other.qos, other.rate) ==
                                            std::tie(row.kind, row.type, row.qos, row.rate);
    });
    if (same != out.end()) {
      same->name += "`, `" + without_prefix(row.name, "~/<instance>/", "");
      continue;
    }
    if (row.kind == "publisher") row.doc = "outputs";
    out.push_back(std::move(row));
  }
  return out;
}

std::string lines_of(const std::string& owner, const std::vector<Row>& rows) {
  std::string out;
  for (const char* kind : {"subscription", "publisher"}) {
    for (const auto& row : condensed(rows))
      if (row.kind == kind) out += "| " + owner + " | " + cells(row) + " |\n";
  }
  return out;
}

std::string tables(const std::vector<Row>& rows) {
  std::string out;
  for (const char* kind : {"publisher", "subscription", "service", "action"}) out += table(rows, kind);
  return out;
}

}  // namespace

std::string interfaces_markdown(const std::vector<EntityInfo>& entities, const std::string& node,
                                const Scene& scene, const std::vector<std::string>& features) {
  std::map<std::string, std::vector<Row>> groups;  // by controllet type; "": the run itself
  for (const auto& entity : entities) {
    const Row row = row_of(entity, node, scene, features);
    auto& rows = groups[row.group];
    const bool known =
        std::any_of(rows.begin(), rows.end(), [&](const Row& other) { return other.key() == row.key(); });
    if (!known) rows.push_back(row);
  }
  std::string out = "\n## The run and its arms\n" + tables(groups[""]);
  out +=
      "\n## Controllets\n\nEvery instance of a type has these interfaces, whether it is active or not. "
      "`<instance>` is its name in the scene.\nEach input `X` also takes goals at `X/goal` (the same type, "
      "reliable, approached smoothly) and publishes `X/reference`, the set-point that is followed now.\n"
      "`~/list_controllets` and `~/list_features` describe inputs and outputs.\n";
  out += "\n| controllet | topic | type | QoS | rate | what |\n|---|---|---|---|---|---|\n";
  for (const auto& [type, rows] : groups) {
    if (!type.empty() && type != kFeatures) out += lines_of(type, rows);
  }
  out += lines_of("any, with the feature", groups[kFeatures]);
  return out;
}

std::string with_tables(const std::string& before, const std::string& tables) {
  const auto at = before.find(kMark);
  if (at == std::string::npos) {
    throw std::invalid_argument(std::string("the page lacks the line that ends its handwritten part: ") +
                                kMark);
  }
  return before.substr(0, at) + kMark + tables;
}

std::string scene_interface_tables(const std::string& name) {
  OpenedScene opened = open_scene(name);
  for (auto& arm : opened.scene.arms) {
    if (arm.hand) arm.movable_fingers = true;  // so that the page lists the gripper
  }
  const Scene scene = opened.scene;
  std::vector<std::string> features;
  for (const auto& type : opened.registry.features()) features.push_back(type.descriptor.type);
  RosAdapter* adapter = nullptr;
  SessionOptions options;
  options.make_adapter = [&](const RunContext& run) {
    RosOptions ros;
    static_cast<RosSection&>(ros) = run.scene->ros;
    auto made = std::make_unique<RosAdapter>(run, std::move(ros));
    adapter = made.get();
    return made;
  };
  const Session session(std::move(opened.scene), opened.registry, std::move(options));
  return interfaces_markdown(adapter->node().entities(), adapter->node().full_name(), scene, features);
}

}  // namespace multipanda::ros
