#include "cli/cockpit_link.hpp"
#include "cockpit/cockpit.hpp"
#include "cockpit/virtual/virtual_source.hpp"

// The library libmultipanda_cockpit.so.
namespace multipanda::cli {
namespace {

class LoadedCockpit final : public CockpitLink {
 public:
  explicit LoadedCockpit(std::optional<std::uint16_t> port) : cockpit_(port) {}

  std::string address() const override { return cockpit_.address(); }
  bool has_page() const override { return cockpit_.has_page(); }
  void on_stop_between_runs(std::function<void()> call) override {
    cockpit_.clients().on_stop_between_runs(std::move(call));
  }
  void show_logs(const std::vector<std::filesystem::path>& logs) override { cockpit_.show_logs(logs); }

  void prepare(SessionOptions& session) override { session.share_records = true; }
  void show(Session& session) override { shown_.emplace(cockpit_, session); }
  void end() override { shown_.reset(); }

  std::function<void(const MujocoPlant&)> watch_world(const Scene& scene) override {
    scene_ = scene;
    feed_ = std::make_shared<cockpit::WorldFeed>(scene);
    return [feed = feed_](const MujocoPlant& plant) { feed->take(plant); };
  }
  void show_world(fci::VirtualArms& arms) override {
    cockpit_.clients().show(std::make_shared<cockpit::VirtualSource>(*scene_, arms, *feed_));
  }
  void close(const std::string& why) override { cockpit_.clients().show(nullptr, why); }

 private:
  std::optional<Scene> scene_;
  std::shared_ptr<cockpit::WorldFeed> feed_;
  cockpit::Cockpit cockpit_;
  std::optional<cockpit::ShownRun> shown_;
};

}  // namespace
}  // namespace multipanda::cli

extern "C" __attribute__((visibility("default"))) unsigned multipanda_cockpit_version() {
  return multipanda::cli::kCockpitVersion;
}
extern "C" __attribute__((visibility("default"))) void* multipanda_open_cockpit(
    const std::optional<std::uint16_t>* port) {
  return new multipanda::cli::LoadedCockpit(*port);
}
