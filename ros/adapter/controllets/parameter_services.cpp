#include "ros/adapter/controllets/parameter_services.hpp"

#include "core/modes/mailbox.hpp"
#include "ros/adapter/controllets/loop_answers.hpp"
#include "runtime/request_words.hpp"
#include "scene/names.hpp"

namespace multipanda::ros {
namespace {

using namespace rcl_interfaces::srv;
using rcl_interfaces::msg::SetParametersResult;

const Doc kDoc{"on request",
               "parameters of the node: <instance>.<parameter>, <instance>.<feature>.<parameter>"};

std::string problem_text(const std::vector<SetParametersResult>& results) {
  std::vector<std::string> reasons;
  for (const auto& result : results) {
    if (!result.successful && !result.reason.empty()) reasons.push_back(result.reason);
  }
  return joined(reasons, "; ");
}

}  // namespace

ParameterServices::ParameterServices(const AdapterWorld& world)
    : world_(world),
      table_(*world.modes),
      events_(*world.node, "/parameter_events", Qos::reliable(1000),
              {"on change", "parameters that changed, whoever changed them"}),
      describe_(*world.executor, *world.node, "~/describe_parameters", kDoc,
                [this](const DescribeParameters::Request& request, const auto& reply) {
                  DescribeParameters::Response response;
                  for (const auto& name : request.names)
                    response.descriptors.push_back(table_.describe(name));
                  reply(std::move(response));
                }),
      get_(*world.executor, *world.node, "~/get_parameters", kDoc,
           [this](const GetParameters::Request& request, const auto& reply) {
             GetParameters::Response response;
             for (const auto& name : request.names) response.values.push_back(table_.get(name));
             reply(std::move(response));
           }),
      types_(*world.executor, *world.node, "~/get_parameter_types", kDoc,
             [this](const GetParameterTypes::Request& request, const auto& reply) {
               GetParameterTypes::Response response;
               for (const auto& name : request.names) response.types.push_back(table_.describe(name).type);
               reply(std::move(response));
             }),
      list_(
          *world.executor, *world.node, "~/list_parameters", kDoc,
          [this](const ListParameters::Request& request, const auto& reply) {
            ListParameters::Response response;
            response.result = table_.list({request.prefixes.begin(), request.prefixes.end()}, request.depth);
            reply(std::move(response));
          }),
      set_(*world.executor, *world.node, "~/set_parameters",
           {"on request", "sets each that is right; answered when the loop has it"},
           [this](const SetParameters::Request& request, const auto& reply) {
             set({request.parameters.begin(), request.parameters.end()}, false, [reply](Results results) {
               SetParameters::Response response;
               response.results.assign(results.begin(), results.end());
               reply(std::move(response));
             });
           }),
      set_atomically_(*world.executor, *world.node, "~/set_parameters_atomically",
                      {"on request", "sets all in the same control cycle, or none"},
                      [this](const SetParametersAtomically::Request& request, const auto& reply) {
                        set({request.parameters.begin(), request.parameters.end()}, true,
                            [reply](const Results& results) {
                              SetParametersAtomically::Response response;
                              response.result.reason = problem_text(results);
                              response.result.successful =
                                  std::all_of(results.begin(), results.end(),
                                              [](const auto& result) { return result.successful; });
                              reply(std::move(response));
                            });
                      }) {}

void ParameterServices::set(const std::vector<rcl_interfaces::msg::Parameter>& parameters, bool all_or_none,
                            std::function<void(Results)> done) {
  Results results(parameters.size());
  std::vector<Request> requests;
  std::vector<std::size_t> which;  // parameter of each request
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    auto request = table_.request(parameters[i], results[i].reason);
    if (!request) continue;
    requests.push_back(*request);
    which.push_back(i);
  }
  const bool whole = requests.size() == parameters.size();
  if (requests.size() > Mailbox::kMaxBatch) {
    const std::string why = "at most " + std::to_string(Mailbox::kMaxBatch) + " parameters in one call";
    for (auto& result : results) result.reason = why;
    return done(std::move(results));
  }
  if (requests.empty() || (all_or_none && !whole)) return done(std::move(results));
  ask_loop(world_, requests,
           [this, results = std::move(results), which, requests,
            done = std::move(done)](const LoopAnswer& answer) mutable {
             for (std::size_t k = 0; k < which.size(); ++k) {
               const Verdict verdict = answer.verdicts[k];
               results[which[k]].successful = verdict == Verdict::accepted;
               if (verdict != Verdict::accepted)
                 results[which[k]].reason = reason(*world_.modes, requests[k], verdict);
             }
             done(std::move(results));
           });
}

void ParameterServices::take(const Event& event) {
  if (event.kind != EventKind::parameter_set || event.verdict != Verdict::accepted) return;
  rcl_interfaces::msg::ParameterEvent message;
  const std::int64_t ns = world_.stamps.at(event.t, host_now());
  message.stamp.sec = static_cast<std::int32_t>(ns / 1'000'000'000);
  message.stamp.nanosec = static_cast<std::uint32_t>(ns % 1'000'000'000);
  message.node = world_.node->full_name();
  message.changed_parameters.push_back(table_.changed(event));
  events_.publish(message);
}

}  // namespace multipanda::ros
