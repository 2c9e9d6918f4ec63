// The extension behind the Python package multipanda_native, which describes and checks everything; a Batch
// is all that it needs. Python's lock is released while worlds compute.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "native/batch.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace multipanda {
namespace {

using Mask = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const double, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

std::span<const std::uint8_t> chosen(const Batch& batch, const Mask& mask) {
  if (mask.shape(0) != batch.count())
    throw std::invalid_argument("expected a mask of " + std::to_string(batch.count()) + " worlds, found " +
                                std::to_string(mask.shape(0)));
  return {mask.data(), mask.shape(0)};
}

ControlledWorld& world_of(Batch& batch, std::size_t k) {
  if (k < batch.count()) return batch.world(k);
  throw std::out_of_range("expected a world below " + std::to_string(batch.count()) + ", found " +
                          std::to_string(k));
}

void reset(Batch& batch, const Mask& mask, const std::vector<std::optional<WorldStart>>& starts) {
  const auto worlds = chosen(batch, mask);
  std::vector<WorldStart> all(batch.count());
  for (std::size_t k = 0; k < std::min(starts.size(), all.size()); ++k)
    if (starts[k]) all[k] = *starts[k];
  const nb::gil_scoped_release released;
  batch.reset(worlds, all);
}

void command(Batch& batch, const Mask& mask, const std::string& what, const std::vector<std::string>& names,
             const Rows& values) {
  const auto worlds = chosen(batch, mask);
  if (values.shape(0) != batch.count())
    throw std::invalid_argument("expected " + std::to_string(batch.count()) + " rows, found " +
                                std::to_string(values.shape(0)));
  batch.command(worlds, what, names, {values.data(), values.size()}, values.shape(1));
}

void step(Batch& batch, const Mask& mask, std::uint64_t cycles) {
  const auto worlds = chosen(batch, mask);
  const nb::gil_scoped_release released;
  batch.step(worlds, cycles);
}

// A view on some numbers of every world's row. It keeps the batch alive.
nb::object view(nb::handle self, std::size_t first, std::size_t size) {
  Batch& batch = nb::cast<Batch&>(self);
  const std::size_t row = batch.layout().size();
  if (first + size > row) throw std::out_of_range("beyond the numbers of a world");
  const std::size_t shape[] = {batch.count(), size};
  const std::int64_t strides[] = {static_cast<std::int64_t>(row), 1};
  return nb::cast(
      nb::ndarray<nb::numpy, double, nb::ndim<2>>(batch.states() + first, 2, shape, self, strides));
}

nb::bytes save(Batch& batch, std::size_t k) {
  const auto bytes = world_of(batch, k).save().pack();
  return nb::bytes(bytes.data(), bytes.size());
}

void restore(Batch& batch, std::size_t k, const nb::bytes& bytes) {
  world_of(batch, k);
  const auto saved = SavedWorld::unpack(static_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  const nb::gil_scoped_release released;
  batch.restore(k, saved);
}

// Name, number of joints and first number of each arm.
std::vector<std::tuple<std::string, std::size_t, std::size_t>> arms(const Batch& batch) {
  std::vector<std::tuple<std::string, std::size_t, std::size_t>> all;
  for (const auto& arm : batch.layout().arms()) all.emplace_back(arm.name, arm.joints, arm.first);
  return all;
}

std::vector<std::pair<std::string, std::size_t>> objects(const Batch& batch) {
  std::vector<std::pair<std::string, std::size_t>> all;
  for (const auto& object : batch.layout().objects()) all.emplace_back(object.name, object.first);
  return all;
}

}  // namespace
}  // namespace multipanda

NB_MODULE(multipanda_native_core, module) {
  using namespace multipanda;
  nb::exception<CommandRefused>(module, "CommandRefused");
  nb::class_<WorldStart>(module, "WorldStart")
      .def(nb::init<>())
      .def_rw("seed", &WorldStart::seed)
      .def_rw("hidden", &WorldStart::hidden)
      .def_rw("q_start", &WorldStart::q_start)
      .def_rw("objects", &WorldStart::objects)
      .def_rw("active", &WorldStart::active, nb::arg().none());
  nb::class_<Batch>(module, "Batch")
      .def(nb::init<const std::string&, std::size_t, std::size_t>(), "scene"_a, "count"_a, "threads"_a)
      .def_prop_ro("count", &Batch::count)
      .def_prop_ro("threads", &Batch::threads)
      .def_prop_ro("seed", [](const Batch& batch) { return batch.scene().seed; })
      .def_prop_ro("arms", &arms)
      .def_prop_ro("objects", &objects)
      .def("view", &view, "first"_a, "size"_a)
      .def("reset", &reset, "mask"_a, "starts"_a)
      .def("command", &command, "mask"_a, "what"_a, "names"_a, "values"_a)
      .def("tell",  // one world; raises CommandRefused
           [](Batch& batch, std::size_t k, const std::string& what, const std::vector<std::string>& names,
              const std::vector<double>& values) { world_of(batch, k).command(what, names, values); })
      .def("step", &step, "mask"_a, "cycles"_a)
      .def("cycles", [](Batch& batch, std::size_t k) { return world_of(batch, k).cycles(); })
      .def("refusal", [](Batch& batch, std::size_t k) { return world_of(batch, k).refusal(); })
      .def("held", [](Batch& batch, std::size_t k) { return world_of(batch, k).held(); })
      .def("active", [](Batch& batch, std::size_t k) { return world_of(batch, k).active(); })
      .def("gripper_answer", [](Batch& batch, std::size_t k,
                                const std::string& arm) { return world_of(batch, k).gripper_answer(arm); })
      .def("save", &save)
      .def("restore", &restore);
}
