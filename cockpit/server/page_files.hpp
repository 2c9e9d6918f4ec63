#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace multipanda::cockpit {

struct PageFile {
  std::string type;  // "text/html; charset=utf-8"
  std::string data;
};

// The files of the page by their path ("/app.js"), and "/" for index.html. Empty without a bundle.
using PageFiles = std::map<std::string, PageFile>;

// Reads the files of a folder: regular ones with names of [a-z0-9._-], kMostFiles of them and kMostBytes
// together. Throws std::runtime_error if there is more, or if a file cannot be read.
PageFiles load_page(const std::filesystem::path& folder);
inline constexpr std::size_t kMostFiles = 32;
inline constexpr std::size_t kMostBytes = 4u << 20;

// Where this program's page is: build/cockpit_page, or share/multipanda/cockpit_page of an installation.
std::filesystem::path page_folder();

}  // namespace multipanda::cockpit
