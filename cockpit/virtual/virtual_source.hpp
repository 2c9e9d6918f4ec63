#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/mujoco/plant.hpp"
#include "cockpit/clients/source.hpp"
#include "cockpit/run/record_view.hpp"
#include "cockpit/run/state_view.hpp"
#include "core/record/cycle_record.hpp"
#include "core/rt/triple_buffer.hpp"
#include "core/types/capacity.hpp"
#include "fci/server/virtual_arms.hpp"
#include "runtime/object_poses.hpp"
#include "runtime/shared_records/shared_records.hpp"
#include "scene/scene.hpp"

namespace multipanda::cockpit {

// Data from the world of virtual arms for the cockpit: a record per period, like those of a run's loop, with
// the single controllet `program`, which stands for the connected programs.
class WorldFeed {
 public:
  using Frames = std::array<ArmFrames, kMaxArms>;

  explicit WorldFeed(const Scene& scene);

  // The world's thread, after a period. No allocation, no lock. A full ring loses records.
  void take(const MujocoPlant& plant);

  // --- the cockpit's thread ---
  const RecordLayout& layout() const { return layout_; }
  RecordRing& ring() { return ring_; }
  const ObjectPoses& objects() const { return objects_; }
  const Frames& frames() {
    frames_.take();
    return frames_.value();
  }

 private:
  struct Arm {
    ArmMode mode = ArmMode::other;
    std::uint32_t config_version = 0;
  };
  void watch(ArmIndex arm, const ArmState& state, const CycleRecord& record);

  RecordLayout layout_;
  RecordRing ring_;
  ObjectPoses objects_;
  TripleBuffer<Frames> frames_;
  Frames next_{};
  std::vector<Arm> arms_;
  HostTime before_;
};

// Virtual arms, which programs command over the network: their states, stop buttons, the fault commands of
// `virtual-arm`, and the objects of their world. It moves no arm.
class VirtualSource final : public Source {
 public:
  // `arms` calls feed.take(); both outlive this. Throws std::runtime_error without memory.
  VirtualSource(const Scene& scene, fci::VirtualArms& arms, WorldFeed& feed);

  nlohmann::json hello() override;
  void update(HostTime now) override;
  std::uint64_t newest() const override { return view().count(); }
  std::span<const double> state(HostTime now) override;
  nlohmann::json slow_state() override;
  std::uint64_t list_version() const override { return 1; }
  nlohmann::json list() override;
  std::vector<nlohmann::json> events(std::uint64_t& from) override { return view().events(from); }
  Plot open_plot(const std::vector<std::string>& fields, std::uint64_t every) override {
    return view().open_plot(fields, every);
  }
  nlohmann::json columns(const Plot& plot) const override { return view().columns(plot); }
  std::uint32_t rows(Plot& plot, std::string& out) override { return records_.rows(plot, out); }
  std::vector<std::string> commands() const override;
  bool is_open(const std::string& command) const override;
  bool moves(const nlohmann::json&) const override { return false; }
  std::variant<Reply, Later> ask(const nlohmann::json& request, HostTime arrived) override;
  std::string come_to_rest(bool) override { return {}; }

 private:
  using Answers = std::vector<std::future<RequestAnswer>>;

  const RecordView& view() const { return records_; }
  std::variant<Reply, Later> press_stops(const nlohmann::json& request, bool pressed);
  Answers begin(const std::string& word, const nlohmann::json& request);
  ArmIndex arm_named(const std::string& name) const;
  static Later when_all(Answers answers, nlohmann::json done);

  const Scene scene_;
  fci::VirtualArms& arms_;
  WorldFeed& feed_;
  const std::vector<std::shared_ptr<const ArmModel>> models_;
  SharedRecords shared_;
  RunEvents run_events_;
  RecordView records_;
  StateView state_view_;
  CycleRecord newest_;
  std::vector<StateView::More> more_;
  std::vector<std::optional<Pose>> poses_;
};

}  // namespace multipanda::cockpit
