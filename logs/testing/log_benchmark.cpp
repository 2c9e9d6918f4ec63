// Throughput of the log. Nothing is asserted; a run of four arms at 1 kHz makes about 18,000
// messages per second.
#include <benchmark/benchmark.h>

#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/recorder.hpp"
#include "logs/testing/test_files.hpp"

namespace multipanda {
namespace {

void one_state_message(benchmark::State& bench) {
  const TestFolder folder;
  McapWriter writer(folder / "log.mcap");
  const auto channel = writer.add_channel<msg::ArmState>("/left/state");
  msg::ArmState state;
  state.arm = "left";
  for (auto* joints : {&state.q, &state.dq, &state.tau_j, &state.tau_j_d, &state.tau_ext})
    joints->assign(7, 0.0);
  std::int64_t cycle = 0;
  for (auto _ : bench) {
    ++cycle;
    state.cycle = static_cast<std::uint64_t>(cycle);
    for (double& q : state.q) q += 1e-5 * static_cast<double>(cycle % 1009);  // digits that do not compress
    writer.write(channel, cycle * 1'000'000, state);
  }
  bench.SetItemsProcessed(bench.iterations());
}
BENCHMARK(one_state_message);

// From the ring to the file with both ends running; the loop's side waits when the ring is full.
void cycles_recorded(benchmark::State& bench) {
  const TestFolder folder;
  RecordLayout layout;
  const auto arms = static_cast<std::size_t>(bench.range(0));
  for (std::size_t i = 0; i < arms; ++i)
    layout.arms.push_back({std::string("arm").append(std::to_string(i)), 7});
  RecordRing ring(layout, 1024);
  Recorder recorder(folder / "log.mcap", layout, ring, std::vector<RecordedArm>(arms), {});
  std::uint64_t cycle = 0;
  for (auto _ : bench) {
    CycleRecord* record = ring.ring.back();
    for (; record == nullptr; record = ring.ring.back()) std::this_thread::yield();
    record->cycle = ++cycle;
    record->t.ns = static_cast<std::int64_t>(cycle) * 1'000'000;
    for (auto& arm : record->arms) arm.q.fill(1e-5 * static_cast<double>(cycle % 1009));
    ring.ring.push();
  }
  bench.counters["times_real_time"] =
      benchmark::Counter(static_cast<double>(bench.iterations()) / 1000, benchmark::Counter::kIsRate);
}
BENCHMARK(cycles_recorded)->Arg(1)->Arg(4)->Arg(16)->UseRealTime();

}  // namespace
}  // namespace multipanda

BENCHMARK_MAIN();
