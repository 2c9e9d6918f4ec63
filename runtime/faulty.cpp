#include "runtime/faulty.hpp"

#include <limits>
#include <stdexcept>

namespace multipanda {
namespace {

class Faulty final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "faulty",
            .doc = "Causes a fault some time after its start, to show how the safety stage reacts.",
            .parameters = spec_table<kParameterCount>(
                parameter_at<kAfter>({.name = "after_s",
                                      .unit = "s",
                                      .initial = {0.5},
                                      .max = 1e6,
                                      .doc = "Time from the start to the fault."}),
                parameter_at<kFault>(choice_parameter(
                    "fault", {"nan", "infinity", "implausible", "exception", "report"}, "Kind of fault.")))};
  }

  LawResult start(ControlContext&) override {
    running_s_ = 0;
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    *arm.tau = arm.terms->c() - kDamping * arm.dq();
    running_s_ += context.dt;
    if (running_s_ < context.parameters->number(kAfter)) return LawResult::ok;
    switch (static_cast<Fault>(context.parameters->choice(kFault))) {
      case Fault::nan:
        (*arm.tau)[0] = std::numeric_limits<double>::quiet_NaN();
        return LawResult::ok;
      case Fault::infinity:
        (*arm.tau)[0] = std::numeric_limits<double>::infinity();
        return LawResult::ok;
      case Fault::implausible:
        (*arm.tau)[0] = 1e9;
        return LawResult::ok;
      case Fault::exception:
        throw std::runtime_error("fault requested by the parameters");
      case Fault::report:
        break;
    }
    return LawResult::fault;
  }

 private:
  enum Parameter : std::size_t { kAfter, kFault, kParameterCount };
  enum class Fault : std::size_t { nan, infinity, implausible, exception, report };
  static constexpr double kDamping = 0.1;  // [N m s/rad]; stable at 1 kHz on the lightest joint
  double running_s_ = 0;
};

}  // namespace

ControlletType faulty_controllet() { return controllet_type<Faulty>(); }

}  // namespace multipanda
