#include "cockpit/cockpit.hpp"

#include "cockpit/log/log_source.hpp"
#include "cockpit/run/run_source.hpp"
#include "cockpit/server/page_files.hpp"
#include "cockpit/server/token.hpp"

namespace multipanda::cockpit {

Cockpit::Cockpit(std::optional<std::uint16_t> port) {
  PageFiles files = load_page(page_folder());
  has_page_ = !files.empty();
  try {
    hub_ = std::make_unique<Hub>(port.value_or(kUsualPort), make_token(), files, desk_);
  } catch (const std::runtime_error&) {
    if (port) throw;
    hub_ = std::make_unique<Hub>(std::uint16_t{0}, make_token(), std::move(files), desk_);
  }
}

void Cockpit::show_logs(const std::vector<std::filesystem::path>& logs) {
  std::vector<std::unique_ptr<LogTable>> tables;
  for (const auto& log : logs) tables.push_back(std::make_unique<LogTable>(log));
  desk_.show(std::make_shared<LogSource>(std::move(tables)));
}

ShownRun::ShownRun(Cockpit& cockpit, Session& session, ObjectPoses* objects) : cockpit_(cockpit) {
  cockpit.desk().show(std::make_shared<RunSource>(session, objects));
}

ShownRun::~ShownRun() { cockpit_.desk().show(nullptr); }

}  // namespace multipanda::cockpit
