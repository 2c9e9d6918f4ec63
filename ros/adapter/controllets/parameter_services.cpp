#include "ros/adapter/controllets/parameter_services.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "common/text.hpp"
#include "core/modes/mailbox.hpp"
#include "ros/rcl/rcl.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {

namespace {

using namespace rcl_interfaces::srv;
using rcl_interfaces::msg::SetParametersResult;

const Doc kDoc{"on request",
               "Parameters of the node: <instance>.<parameter>, <instance>.<feature>.<parameter>"};

std::string problem_text(const std::vector<SetParametersResult>& results) {
  std::vector<std::string> reasons;
  for (const auto& result : results) {
    if (!result.successful && !result.reason.empty()) reasons.push_back(result.reason);
  }
  return joined(reasons, "; ");
}

}  // namespace

ParameterServices::ParameterServices(const AdapterContext& run)
    : run_(run),
      table_(*run.modes),
      events_(*run.node, "/parameter_events", Qos::reliable(1000),
              {"on change", "Parameter changes from any source."}),
      describe_(*run.executor, *run.node, "~/describe_parameters", kDoc,
                [this](const DescribeParameters::Request& request, const auto& reply) {
                  DescribeParameters::Response response;
                  for (const auto& name : request.names)
                    response.descriptors.push_back(table_.describe(name));
                  reply(std::move(response));
                }),
      get_(*run.executor, *run.node, "~/get_parameters", kDoc,
           [this](const GetParameters::Request& request, const auto& reply) {
             GetParameters::Response response;
             for (const auto& name : request.names) response.values.push_back(table_.get(name));
             reply(std::move(response));
           }),
      types_(*run.executor, *run.node, "~/get_parameter_types", kDoc,
             [this](const GetParameterTypes::Request& request, const auto& reply) {
               GetParameterTypes::Response response;
               for (const auto& name : request.names) response.types.push_back(table_.describe(name).type);
               reply(std::move(response));
             }),
      list_(
          *run.executor, *run.node, "~/list_parameters", kDoc,
          [this](const ListParameters::Request& request, const auto& reply) {
            ListParameters::Response response;
            response.result = table_.list({request.prefixes.begin(), request.prefixes.end()}, request.depth);
            reply(std::move(response));
          }),
      set_(*run.executor, *run.node, "~/set_parameters",
           {"on request", "Sets each valid value; responds after the loop has accepted it."},
           [this](const SetParameters::Request& request, const auto& reply) {
             set({request.parameters.begin(), request.parameters.end()}, false, [reply](Results results) {
               SetParameters::Response response;
               response.results.assign(results.begin(), results.end());
               reply(std::move(response));
             });
           }),
      set_atomically_(*run.executor, *run.node, "~/set_parameters_atomically",
                      {"on request", "Sets all in the same control cycle, or none."},
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

// A call in progress.
struct ParameterServices::Job {
  Results results;
  std::vector<Request> requests;   // for the valid values
  std::vector<std::size_t> which;  // parameter of each request
  std::size_t posted = 0;          // number of requests posted so far
  std::function<void(Results)> done;
};

void ParameterServices::set(const std::vector<rcl_interfaces::msg::Parameter>& parameters, bool all_or_none,
                            std::function<void(Results)> done) {
  const auto job = std::make_shared<Job>();
  job->results.resize(parameters.size());
  job->done = std::move(done);
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    auto request = table_.request(parameters[i], job->results[i].reason);
    if (!request) continue;
    job->requests.push_back(*request);
    job->which.push_back(i);
  }
  if (all_or_none && job->requests.size() < parameters.size()) return job->done(std::move(job->results));
  if (all_or_none && job->requests.size() > Mailbox::kMaxBatch) {
    const std::string why =
        fmt::format("at most {} parameters can be set in the same cycle", Mailbox::kMaxBatch);
    for (auto& result : job->results) result.reason = why;
    return job->done(std::move(job->results));
  }
  set_next(job);
}

void ParameterServices::set_next(const std::shared_ptr<Job>& job) {
  const std::size_t begin = job->posted;
  const std::size_t count = std::min(job->requests.size() - begin, Mailbox::kMaxBatch);
  if (count == 0) return job->done(std::move(job->results));
  const auto first = job->requests.begin() + static_cast<std::ptrdiff_t>(begin);
  request_loop(run_, {first, first + static_cast<std::ptrdiff_t>(count)},
               [this, job, begin, count](const LoopAnswer& answer) {
                 for (std::size_t k = 0; k < count; ++k) {
                   const Verdict verdict = answer.verdicts[k];
                   auto& result = job->results[job->which[begin + k]];
                   result.successful = verdict == Verdict::accepted;
                   if (verdict != Verdict::accepted)
                     result.reason = reason(*run_.modes, job->requests[begin + k], verdict);
                 }
                 job->posted = begin + count;
                 set_next(job);
               });
}

void ParameterServices::take(const Event& event) {
  if (event.kind != EventKind::parameter_set || event.verdict != Verdict::accepted) return;
  rcl_interfaces::msg::ParameterEvent message;
  const std::int64_t ns = run_.stamps.at(event.t, host_now());
  message.stamp.sec = static_cast<std::int32_t>(ns / 1'000'000'000);
  message.stamp.nanosec = static_cast<std::uint32_t>(ns % 1'000'000'000);
  message.node = run_.node->full_name();
  message.changed_parameters.push_back(table_.changed(event));
  events_.publish(message);
}

namespace {

constexpr double kLoopTimeout = MultimodeController::kPatience;  // for the loop's answer [s]

}  // namespace

std::size_t LoopAnswer::first_refused() const {
  return static_cast<std::size_t>(
      std::find_if(verdicts.begin(), verdicts.end(), [](Verdict v) { return v != Verdict::accepted; }) -
      verdicts.begin());
}

void request_loop(const AdapterContext& run, const std::vector<Request>& requests,
                  std::function<void(const LoopAnswer&)> done) {
  LoopAnswer result;
  result.verdicts.assign(requests.size(), Verdict::timeout);
  if (!requests.empty()) result.answer.kind = requests.back().kind;
  std::uint64_t ticket = 0;
  const bool late = !run.executor->late(kLoopTimeout).empty();
  const Verdict posted =
      late ? Verdict::timeout : run.modes->post(requests, ticket, kLoopTimeout, run.executor->sent());
  if (posted != Verdict::accepted) {
    result.answer.verdict = posted;
    std::fill(result.verdicts.begin(), result.verdicts.end(), posted);
    return done(result);
  }
  const HostTime posted_at = host_now();
  MultimodeController* modes = run.modes;
  const std::uint64_t first = ticket - requests.size() + 1;
  run.executor->poll_until(
      [modes, ticket, first, posted_at, result = std::move(result), done = std::move(done)]() mutable {
        // The loop answers in order.
        Answer last;
        const bool answered = modes->poll(ticket, last);
        const double waited = seconds(host_now() - posted_at);
        if (!answered && waited <= kLoopTimeout) return false;
        result.answer.verdict = Verdict::timeout;
        if (!answered && !modes->withdraw(ticket)) {  // the loop has taken them: its answer follows
          if (waited <= kLoopTimeout + MultimodeController::kAnswerPatience) return false;
          result.answer.verdict = Verdict::pending;
          result.verdicts.assign(result.verdicts.size(), Verdict::pending);
        }
        if (answered) result.answer = last;
        for (std::size_t k = 0; k < result.verdicts.size(); ++k) {
          Answer answer;
          if (modes->poll(first + k, answer)) result.verdicts[k] = answer.verdict;
        }
        done(result);
        return true;
      });
}

}  // namespace multipanda::ros
