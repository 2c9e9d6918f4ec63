// The extension behind the Python package multipanda_native, which documents and checks everything; it needs
// only a Batch. Python's lock is released while worlds compute.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "common/text.hpp"
#include "python_bindings/batch.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

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

using OwnRows = std::map<std::string, Rows>;

Batch::OwnNumbers own_numbers(const Batch& batch, const OwnRows& rows) {
  Batch::OwnNumbers own;
  for (const auto& [key, numbers] : rows) {
    if (numbers.shape(0) != batch.count())
      throw std::invalid_argument("expected " + std::to_string(batch.count()) + " rows, found " +
                                  std::to_string(numbers.shape(0)));
    own[key] = {numbers.data(), numbers.shape(1)};
  }
  return own;
}

void command(Batch& batch, const Mask& mask, const std::string& request, const OwnRows& rows) {
  batch.command(chosen(batch, mask), nlohmann::json::parse(request), own_numbers(batch, rows));
}

void tell(Batch& batch, const std::string& request, const OwnRows& rows) {
  const auto own = own_numbers(batch, rows);
  world_of(batch, 0).command(Batch::request_of(0, nlohmann::json::parse(request), own));
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

// Name and number of joints of each arm, and its fields: name, first number and how many.
using Fields = std::vector<std::tuple<std::string, std::size_t, std::size_t>>;
std::vector<std::tuple<std::string, std::size_t, Fields>> arms(const Batch& batch) {
  std::vector<std::tuple<std::string, std::size_t, Fields>> all;
  for (const auto& arm : batch.layout().arms()) {
    Fields fields;
    for (const auto& field : arm.fields) fields.emplace_back(field.name, field.offset / 8, field.count);
    all.emplace_back(arm.name, arm.joints, std::move(fields));
  }
  return all;
}

std::vector<std::pair<std::string, std::size_t>> objects(const Batch& batch) {
  std::vector<std::pair<std::string, std::size_t>> all;
  for (const auto& object : batch.layout().objects()) all.emplace_back(object.name, object.first);
  return all;
}

// The controllers' model of an arm of a scene, at any state: the numbers of the loop.
class ArmTerms {
 public:
  // A scene by name or file, with other values (with_values).
  ArmTerms(const std::string& scene, const std::vector<std::string>& settings, const std::string& arm) {
    const OpenedScene opened = open_scene(scene);
    begin(settings.empty() ? opened.scene : with_values(opened, settings), arm);
  }
  // A scene as text.
  ArmTerms(const std::string& text, const std::string& arm) {
    begin(parse_scene(text, "model", Registry::with_builtins()), arm);
  }

  std::size_t joints() const { return terms_->joint_count(); }
  const ArmModel& model() const { return terms_->model(); }
  ModelTerms& at(const Eigen::VectorXd& q, const Eigen::VectorXd& dq) {
    const auto n = static_cast<Eigen::Index>(joints());
    if (q.size() != n || dq.size() != n)
      throw std::invalid_argument("expected " + std::to_string(n) + " numbers, one per joint");
    terms_->update(JointVector(q), JointVector(dq));
    return *terms_;
  }
  void set_load(double mass, const Vector3& com, const Matrix3& inertia) {
    config_.load = {.mass = mass, .p_FC = com, .inertia_C = inertia};
    terms_->set_config(config_.frames, config_.tool, config_.load);
  }
  void set_frames(const std::optional<std::vector<double>>& X_FE,
                  const std::optional<std::vector<double>>& X_EK) {
    if (X_FE) config_.frames.X_FE = Pose::from(X_FE->data());
    if (X_EK) config_.frames.X_EK = Pose::from(X_EK->data());
    terms_->set_config(config_.frames, config_.tool, config_.load);
  }

 private:
  void begin(const Scene& scene, const std::string& name) {
    const auto arm = std::ranges::find(scene.arms, name, &SceneArm::name);
    if (arm == scene.arms.end())
      throw std::invalid_argument("scene '" + scene.name + "' has no arm '" + name + "'" +
                                  name_hint(name, names_in(scene.arms), "it has none"));
    if (arm->mount)
      throw std::invalid_argument("arm '" + name + "' stands on another arm, which moves its base");
    terms_.emplace(build_controller_model(*arm));
    config_ = arm_config(*arm);
    terms_->set_config(config_.frames, config_.tool, config_.load);
  }

  std::optional<ModelTerms> terms_;
  ArmConfig config_;
};

std::array<double, 7> hand_pose(ArmTerms& arm, const Eigen::VectorXd& q) {
  return arm.at(q, 0 * q).X_WE().values();
}
Eigen::MatrixXd jacobian(ArmTerms& arm, const Eigen::VectorXd& q) { return arm.at(q, 0 * q).J_V_WE(); }
Eigen::MatrixXd mass(ArmTerms& arm, const Eigen::VectorXd& q) { return arm.at(q, 0 * q).M(); }
Eigen::VectorXd gravity(ArmTerms& arm, const Eigen::VectorXd& q) { return arm.at(q, 0 * q).g(); }
Eigen::VectorXd coriolis(ArmTerms& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& dq) {
  return arm.at(q, dq).c();
}

// The model of a scene's world in MuJoCo's binary format, with other values (with_values).
nb::bytes world_model(const std::string& scene, const std::vector<std::string>& settings) {
  const OpenedScene opened = open_scene(scene);
  const MujocoBackend backend(settings.empty() ? opened.scene : with_values(opened, settings),
                              {.pace = Pace::unpaced, .looks = true});
  const mjModel* model = backend.world().model();
  std::string bytes(static_cast<std::size_t>(mj_sizeModel(model)), '\0');
  mj_saveModel(model, nullptr, bytes.data(), static_cast<mjtSize>(bytes.size()));
  return nb::bytes(bytes.data(), bytes.size());
}

}  // namespace
}  // namespace multipanda

NB_MODULE(multipanda_native_core, module) {
  using namespace multipanda;
  nb::exception<RequestRefused>(module, "RequestRefused");
  nb::class_<WorldStart>(module, "WorldStart")
      .def(nb::init<>())
      .def_rw("seed", &WorldStart::seed)
      .def_rw("hidden", &WorldStart::hidden)
      .def_rw("q_start", &WorldStart::q_start)
      .def_rw("objects", &WorldStart::objects)
      .def_rw("active", &WorldStart::active, nb::arg().none());
  nb::class_<ArmTerms>(module, "ArmTerms")
      .def(nb::init<const std::string&, const std::vector<std::string>&, const std::string&>())
      .def(nb::init<const std::string&, const std::string&>())
      .def_prop_ro("joints", &ArmTerms::joints)
      .def_prop_ro("home", [](const ArmTerms& arm) { return Eigen::VectorXd(arm.model().q_home()); })
      .def_prop_ro("q_min", [](const ArmTerms& arm) { return Eigen::VectorXd(arm.model().limits().q_min); })
      .def_prop_ro("q_max", [](const ArmTerms& arm) { return Eigen::VectorXd(arm.model().limits().q_max); })
      .def("set_load", &ArmTerms::set_load)
      .def("set_frames", &ArmTerms::set_frames, nb::arg().none(), nb::arg().none())
      .def("pose", &hand_pose)
      .def("jacobian", &jacobian)
      .def("mass", &mass)
      .def("gravity", &gravity)
      .def("coriolis", &coriolis);
  module.def("world_model", &world_model, "scene"_a, "settings"_a);
  nb::class_<Batch>(module, "Batch")
      .def(nb::init<const std::string&, std::size_t, std::size_t>(), "scene"_a, "count"_a, "threads"_a)
      .def_prop_ro("count", &Batch::count)
      .def_prop_ro("threads", &Batch::threads)
      .def_prop_ro("seed", [](const Batch& batch) { return batch.scene().seed; })
      .def_prop_ro("arms", &arms)
      .def_prop_ro("objects", &objects)
      .def("view", &view, "first"_a, "size"_a)
      .def("reset", &reset, "mask"_a, "starts"_a)
      .def("command", &command, "mask"_a, "request"_a, "rows"_a)
      .def("tell", &tell, "request"_a, "rows"_a)  // the first world; raises RequestRefused
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
