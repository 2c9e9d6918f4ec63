#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "cli/program.hpp"
#include "motion_generators/publish.hpp"
#include "motion_generators/set_point_channel.hpp"

namespace multipanda::cli {

// The run that a generator publishes to, and the channel: socket or ROS.
struct ChannelArguments {
  std::string socket;
  bool ros = false;
  std::string node = "/multipanda";
};

void add_channel_arguments(CLI::App* command, ChannelArguments& arguments);

// `own_node`: name of this program's ROS node. Throws UsageError for arguments that exclude each other, and
// the channel's exceptions.
std::unique_ptr<SetPointChannel> open_channel(const ChannelArguments& arguments, const std::string& own_node);

// Raises the priority of the calling thread, which publishes; returns the result. Call it after the channel
// is open, so that the channel's threads keep their priority.
nlohmann::json set_up_publishing_thread();

// The part of a publication's report shared by all generators: end, samples, rate, lateness.
nlohmann::json publication_of(const PublishReport& report);

// The file in config/<folder> with this name, or the path if it contains a slash or ends in .yaml. Throws
// UsageError with the prefix `command` for an unknown name.
std::filesystem::path config_file(const std::string& command, const std::string& folder,
                                  const std::string& name);

}  // namespace multipanda::cli
