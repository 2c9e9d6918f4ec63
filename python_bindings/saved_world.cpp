#include "python_bindings/saved_world.hpp"

#include <stdexcept>

namespace multipanda {
namespace {

using Json = nlohmann::json;

constexpr const char* kFormat = "multipanda world 2";

}  // namespace

std::vector<std::uint8_t> SavedWorld::pack() const {
  Json told = Json::array();
  for (const auto& one : commands) told.push_back({one.cycle, one.request});
  const Json all{{"format", kFormat},
                 {"scene", scene},
                 {"seed", start.seed},
                 {"hidden", start.hidden},
                 {"q_start", start.q_start},
                 {"objects", start.objects},
                 {"active", start.active ? Json(*start.active) : Json()},
                 {"commands", told},
                 {"cycles", cycles},
                 {"state", state},
                 {"refusal", refusal}};
  return Json::to_cbor(all);
}

SavedWorld SavedWorld::unpack(const std::uint8_t* bytes, std::size_t size) {
  try {
    const Json all = Json::from_cbor(bytes, bytes + size);
    if (all.at("format") != kFormat) throw std::invalid_argument(all.at("format").get<std::string>());
    SavedWorld saved;
    all.at("scene").get_to(saved.scene);
    all.at("seed").get_to(saved.start.seed);
    all.at("hidden").get_to(saved.start.hidden);
    all.at("q_start").get_to(saved.start.q_start);
    all.at("objects").get_to(saved.start.objects);
    if (const Json& active = all.at("active"); !active.is_null())
      saved.start.active = active.get<std::vector<std::string>>();
    for (const auto& one : all.at("commands")) saved.commands.push_back({one.at(0), one.at(1)});
    all.at("cycles").get_to(saved.cycles);
    all.at("state").get_to(saved.state);
    all.at("refusal").get_to(saved.refusal);
    return saved;
  } catch (const std::exception& error) {
    throw std::invalid_argument(std::string("expected what save() returned (") + kFormat +
                                "), found other bytes: " + error.what());
  }
}

}  // namespace multipanda
