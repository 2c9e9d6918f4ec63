#include "experiments/run_data.hpp"

#include <cstdio>
#include <filesystem>
#include <unistd.h>

#include <gtest/gtest.h>

#include "common/process.hpp"
#include "logs/export.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::run_data_test {
namespace {

namespace fs = std::filesystem;

// Compares every array of the first archive with the second. Further arrays of the second are not needed by
// figures. One row of `kind` and `frame` represents all rows.
constexpr const char* kCompare = R"(
import sys, numpy as np
mine, log = np.load(sys.argv[1]), np.load(sys.argv[2])
names = [n for n in mine.files]
assert len(names) > 30, names
for name in names:
    a, b = mine[name], log[name]
    if name.endswith(('/kind', '/frame')):
        assert a[0] == b[0], name
        continue
    assert a.shape == b.shape, (name, a.shape, b.shape)
    if a.dtype.kind == 'U':
        assert (a == b).all(), name
    elif name.endswith('/t') or '/model/' in name:  # computed twice, rounded apart
        assert np.abs(a - b).max() < 1e-12, name
    elif '/outputs/' in name:  # single precision in logs
        assert np.array_equal(np.float32(a), np.float32(b), equal_nan=True), name
    else:
        assert np.array_equal(a, b.astype(float), equal_nan=True), (name, np.abs(a - b).max())
assert {'arm/model/pose_position', 'cartesian/pose/value', 'cartesian/outputs/position_error_m/values'} <= set(names), names
)";

TEST(RunData, EqualTheArraysOfTheLogExport) {
  const fs::path folder = fs::path(testing::TempDir()) / ("run_data_" + std::to_string(getpid()));
  fs::create_directories(folder);
  OpenedScene opened = open_scene("one_arm");
  std::optional<RunData> data;
  SessionOptions options{.paced = false, .duration_s = 2.5, .record = folder};
  options.log_every.model = 5;
  options.observer = [&data](const CycleRecord& record) { data->take(record); };
  Session session(std::move(opened.scene), opened.registry, std::move(options));
  data.emplace(session.scene(), session.layout(), session.models(), 5);
  session.start();
  const RunSummary summary = session.finish();
  data->write(folder / "mine.npz");
  export_npz(summary.log, folder / "log.npz");
  const ProgramResult compared = run_program(
      MULTIPANDA_SOURCE_DIR "/.venv/bin/python",
      {"-I", "-B", "-c", kCompare, (folder / "mine.npz").string(), (folder / "log.npz").string()});
  EXPECT_TRUE(compared.good()) << compared.output;
  fs::remove_all(folder);
}

}  // namespace
}  // namespace multipanda::run_data_test
