#include "ros/adapter/controllets/controllets.hpp"

#include "ros/adapter/controllets/inputs.hpp"
#include "ros/adapter/controllets/mode_services.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"
#include "ros/adapter/controllets/value_topics.hpp"

namespace multipanda::ros {

AdapterParts make_controllets(const AdapterContext& run, const Inputs*& inputs) {
  const auto codecs = codecs_of(run.scene->plugins);
  AdapterParts parts;
  parts.push_back(std::make_unique<ModeServices>(run, codecs));
  auto made = std::make_unique<Inputs>(run, codecs);
  inputs = made.get();
  parts.push_back(std::move(made));
  parts.push_back(std::make_unique<ValueTopics>(run, codecs));
  if (run.options->parameter_services) parts.push_back(std::make_unique<ParameterServices>(run));
  return parts;
}

}  // namespace multipanda::ros
