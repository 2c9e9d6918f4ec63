#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "cli/program.hpp"
#include "generators/publish.hpp"
#include "generators/set_point_link.hpp"

namespace multipanda::cli {

// Which run a generator publishes to, and by which way.
struct LinkWords {
  std::string socket;
  bool ros = false;
  std::string node = "/multipanda";
};

void add_link_words(CLI::App* command, LinkWords& words);

// `own_node`: this program's name on ROS. Throws UsageError for words that do not go together, and what the
// link throws.
std::unique_ptr<SetPointLink> open_link(const LinkWords& words, const std::string& own_node);

// Priority for the thread that publishes, once its link is open (whose threads keep theirs); what became of
// it.
nlohmann::json set_up_publishing_thread();

// What became of a publication, as far as it is the same for every generator: end, samples, rate, lateness.
nlohmann::json publication_of(const PublishReport& report);

// A name of a file in config/<folder>, or its path (with a slash or ending in .yaml). Throws UsageError,
// beginning with `command`, for a name that there is not.
std::filesystem::path config_file(const std::string& command, const std::string& folder,
                                  const std::string& name);

}  // namespace multipanda::cli
