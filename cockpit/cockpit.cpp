#include "cockpit/cockpit.hpp"

#include "cockpit/log/log_table.hpp"
#include "cockpit/run/run_source.hpp"
#include "common/own_files.hpp"

namespace multipanda::cockpit {

namespace {

// Path of this program's page: build/cockpit_page, or share/multipanda/cockpit_page of an installation.
std::filesystem::path page_folder() {
  const auto shared = share_folder() / "cockpit_page";
  if (std::filesystem::is_directory(shared)) return shared;
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "cockpit_page";
}

}  // namespace

Cockpit::Cockpit(std::optional<std::uint16_t> port)
    : hub_(std::make_unique<Hub>(
          Hub::Options{
              .port = port.value_or(kUsualPort), .or_any = !port, .page = page_folder(), .limits = {}},
          clients_)) {}

void Cockpit::show_logs(const std::vector<std::filesystem::path>& logs) {
  std::vector<std::unique_ptr<LogTable>> tables;
  for (const auto& log : logs) tables.push_back(std::make_unique<LogTable>(log));
  clients_.show(std::make_shared<LogSource>(std::move(tables)));
}

ShownRun::ShownRun(Cockpit& cockpit, Session& session) : cockpit_(cockpit) {
  cockpit.clients().show(std::make_shared<RunSource>(session));
}

ShownRun::~ShownRun() { cockpit_.clients().show(nullptr); }

}  // namespace multipanda::cockpit
