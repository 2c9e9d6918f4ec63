#include "sysid/identification/identification_json.hpp"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "report/page_script.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

template <typename Vector>
Json numbers(const Vector& values) {
  return std::vector<double>(values.data(), values.data() + values.size());
}

// Half of the 95 % interval over the value, up to which a figure counts as known.
constexpr double kConstrained = 0.3;

Json finite(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json to_json(const RigidBody& body) {
  const Matrix3& I = body.inertia;
  return {{"mass_kg", body.mass},
          {"com_m", numbers(body.com)},
          {"inertia_kg_m2",
           {{"xx", I(0, 0)},
            {"yy", I(1, 1)},
            {"zz", I(2, 2)},
            {"xy", I(0, 1)},
            {"xz", I(0, 2)},
            {"yz", I(1, 2)}}}};
}

void add(Json& json, const char* key, const JointVector& values) {
  if (values.size() > 0) json[key] = numbers(values);
}

Json parameters(const RobotDescription& robot) {
  Json out;
  for (std::size_t i = 1; i < robot.links.size(); ++i)
    out["link" + std::to_string(i)] = to_json(robot.links[i]);
  if (robot.link_friction) {
    const FrictionLaw& law = *robot.link_friction;
    Json& friction = out["link_friction"] = Json::object();
    add(friction, "offset_nm", law.offset);
    add(friction, "viscous_nm_s_per_rad", law.viscous);
    add(friction, "stribeck_nm", law.stribeck);
    for (const PreslidingElement& e : law.presliding) {
      friction["presliding"].push_back(
          {{"distance_rad", e.distance}, {"amplitude_nm", numbers(e.amplitude)}});
    }
    if (law.sigmoid) {
      friction["sigmoid"] = {{"p1_nm", numbers(law.sigmoid->p1)},
                             {"p2_s_per_rad", numbers(law.sigmoid->p2)},
                             {"p3_rad_per_s", numbers(law.sigmoid->p3)}};
    }
  }
  if (robot.torque_sensor) {
    Json& sensor = out["torque_sensor"] = Json::object();
    add(sensor, "gain", robot.torque_sensor->gain);
    add(sensor, "offset_nm", robot.torque_sensor->offset);
  }
  out["base_tilt_rad"] = numbers(robot.base_tilt);
  return out;
}

Json with_mean(const JointVector& rmse) {
  if (rmse.size() == 0) return nullptr;
  return {{"mean", rmse.mean()}, {"joints", numbers(rmse)}};
}

Json motion(const Identification& id) {
  return {{"q_min_rad", numbers(id.q_min)},
          {"q_max_rad", numbers(id.q_max)},
          {"dq_max_rad_per_s", numbers(id.dq_max)},
          {"repeated_after_s", id.repeated_after}};
}

Json base(const LinearFit& linear) {
  Json out{{"rank", linear.base.rank()},
           {"condition_raw", finite(linear.condition.raw)},
           {"condition_scaled", finite(linear.condition.scaled)},
           {"identifiable_alone", linear.base.alone},
           {"identifiable_combined", linear.base.combined},
           {"unidentifiable", linear.base.unidentifiable},
           {"residuals_correlated_s", 0.01 * static_cast<double>(linear.longest_lag)}};
  for (std::size_t i = 0; i < linear.names.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double relative = linear.half95[k] / std::abs(linear.value[k]);
    out["values"].push_back({{"name", linear.names[i]},
                             {"unit", linear.units[i]},
                             {"value", finite(linear.value[k])},
                             {"half95", finite(linear.half95[k])},
                             {"constrained", relative < kConstrained ? "yes"
                                             : relative < 1          ? "hardly"
                                                                     : "no"}});
  }
  return out;
}

}  // namespace

Json to_json(const Identification& id) {
  Json out{{"rmse_train", id.rmse_train.size() > 0 ? Json(id.rmse_train.mean()) : Json()},
           {"rmse_heldout", id.rmse_heldout.size() > 0 ? Json(id.rmse_heldout.mean()) : Json()},
           {"consistent", id.consistent},
           {"parameters", parameters(id.robot)},
           {"dissipative", id.dissipative},
           {"rmse_train_joints", numbers(id.rmse_train)},
           {"rmse_heldout_joints", numbers(id.rmse_heldout)},
           {"rmse_all", with_mean(id.rmse_all)},
           {"rmse_expected", with_mean(id.rmse_expected)},
           {"motion", motion(id)},
           {"family", id.family},
           {"seconds", id.seconds_used},
           {"cross_validation", Json::array()},
           {"cuts", Json::array()},
           {"models_beside", Json::array()}};
  for (const FamilyScore& score : id.scores) {
    out["cross_validation"].push_back({{"family", score.name},
                                       {"coefficients", score.coefficients},
                                       {"mean", score.mean},
                                       {"joints", numbers(score.rmse)},
                                       {"eligible", score.eligible},
                                       {"chosen", score.chosen}});
  }
  for (const TimeCut& cut : id.cuts) {
    out["cuts"].push_back({{"trained_from", cut.from},
                           {"trained_to", cut.to},
                           {"train", with_mean(cut.rmse_train)},
                           {"test", with_mean(cut.rmse_test)},
                           {"expected", with_mean(cut.rmse_expected)}});
  }
  for (const ModelBeside& model : id.beside) {
    out["models_beside"].push_back(
        {{"name", model.name}, {"mean", model.mean}, {"joints", numbers(model.rmse)}});
  }
  out["prior_consistent"] = id.prior_consistent;
  out["base_parameters"] = base(id.linear);
  if (id.payload) {
    out["payload"] = to_json(*id.payload);
    out["payload"]["mass_half95_kg"] = finite(id.payload_mass_half95);
    out["payload"]["com_half95_m"] = finite(id.payload_com_half95);
  }
  out["warnings"] = id.warnings;
  return out;
}

Json to_json_with_series(const Identification& id) {
  Json out = to_json(id);
  out["series"] = Json::array();
  for (const ResidualSeries& series : id.series) {
    Json one{{"source", series.source}, {"t", numbers(series.t)}};
    const auto columns = [&](const char* key, const Eigen::MatrixXd& values) {
      for (Eigen::Index j = 0; j < values.cols(); ++j) {
        one[key].push_back(numbers(Eigen::VectorXd(values.col(j))));
      }
    };
    columns("measured", series.measured);
    columns("predicted", series.predicted);
    columns("prior", series.prior);
    out["series"].push_back(std::move(one));
  }
  return out;
}

Json to_json(const Prediction& prediction) {
  return {{"rmse", numbers(prediction.rmse)},
          {"rmse_mean", prediction.rmse_mean},
          {"rmse_unfiltered", numbers(prediction.rmse_unfiltered)},
          {"rmse_unfiltered_mean", prediction.rmse_unfiltered.mean()}};
}

void write_identification_page(const Identification& identification, const fs::path& directory) {
  const PageScript script("sysid/identification/identification_page.py", "the page of the identification");
  fs::create_directories(directory);
  const fs::path data = directory / "identification.json";
  std::ofstream out(data);
  out << to_json_with_series(identification).dump();
  out.close();
  if (!out) throw std::runtime_error(data.string() + " cannot be written");
  script.run({data.string(), "--out", directory.string()});
}

}  // namespace multipanda
