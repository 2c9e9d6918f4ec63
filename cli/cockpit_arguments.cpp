#include "cli/cockpit_arguments.hpp"

#include <fmt/format.h>

#include "cli/program.hpp"

namespace multipanda::cli {

void add_cockpit_arguments(CLI::App* command, CockpitArguments& arguments, const std::string& help) {
  command
      ->add_option_function<std::vector<std::string>>(
          "--cockpit",
          [&arguments](const std::vector<std::string>& values) {
            arguments.asked = true;
            if (values.empty() || values.front().empty()) return;
            std::size_t used = 0;
            int port = -1;
            try {
              port = std::stoi(values.front(), &used);
            } catch (const std::exception&) {
            }
            if (used != values.front().size() || port < 0 || port > 65535)
              throw UsageError(
                  fmt::format("--cockpit: expected a port from 0 to 65535, found '{}'", values.front()));
            arguments.port = static_cast<std::uint16_t>(port);
          },
          fmt::format("{} (default {}, or a free one; 0: a free one; docs/cockpit.md)", help,
                      cockpit::Cockpit::kUsualPort))
      ->expected(0, 1)
      ->type_name("[PORT]");
}

OpenedCockpit::OpenedCockpit(const CockpitArguments& arguments, const Console& console) : console_(console) {
  if (arguments.asked) cockpit_ = std::make_unique<cockpit::Cockpit>(arguments.port);
}

void OpenedCockpit::on_owed_stop(std::function<void()> call) {
  if (cockpit_) cockpit_->desk().on_owed_stop(std::move(call));
}

void OpenedCockpit::prepare(const Scene& scene, SessionOptions& session) {
  if (!cockpit_) return;
  objects_ = std::make_shared<cockpit::ObjectPoses>(scene);
  session.share_records = true;
  session.on_loop = [objects = objects_, before = session.on_loop](const Tick& tick, const Backend& backend) {
    if (before) before(tick, backend);
    objects->on_loop(tick, backend);
  };
}

void OpenedCockpit::show(Session& session) {
  if (!cockpit_) return;
  shown_ = std::make_unique<cockpit::ShownRun>(*cockpit_, session, objects_.get());
  if (!printed_) print_address(*cockpit_, console_);
  printed_ = true;
}

void OpenedCockpit::end() { shown_.reset(); }

void print_address(const cockpit::Cockpit& cockpit, const Console& console) {
  if (!cockpit.has_page())
    console.line("this build has no cockpit page (docs/cockpit.md); programs can use the cockpit at");
  console.line(cockpit.address());
}

}  // namespace multipanda::cli
