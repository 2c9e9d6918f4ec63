#include "cockpit/server/page_files.hpp"

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include <fmt/format.h>

#include "support/own_files.hpp"

namespace multipanda::cockpit {
namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::string>& types() {
  static const std::map<std::string, std::string> kTypes = {{".html", "text/html; charset=utf-8"},
                                                            {".js", "text/javascript; charset=utf-8"},
                                                            {".css", "text/css; charset=utf-8"},
                                                            {".json", "application/json"},
                                                            {".map", "application/json"},
                                                            {".svg", "image/svg+xml"},
                                                            {".png", "image/png"},
                                                            {".ico", "image/x-icon"},
                                                            {".woff2", "font/woff2"},
                                                            {".wasm", "application/wasm"},
                                                            {".txt", "text/plain; charset=utf-8"}};
  return kTypes;
}

bool is_plain(const std::string& name) {
  return !name.starts_with('.') && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
  });
}

std::string read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string data((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  if (!in) throw std::runtime_error(fmt::format("cannot read {}", file.string()));
  return data;
}

}  // namespace

PageFiles load_page(const fs::path& folder) {
  PageFiles files;
  std::error_code absent;
  std::size_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(folder, absent)) {
    const std::string name = entry.path().filename().string();
    const auto type = types().find(entry.path().extension().string());
    if (!entry.is_regular_file() || !is_plain(name) || type == types().end()) continue;
    PageFile file{.type = type->second, .data = read(entry.path())};
    bytes += file.data.size();
    if (files.size() == kMostFiles || bytes > kMostBytes)
      throw std::runtime_error(fmt::format("{}: a page has at most {} files of {} bytes together",
                                           folder.string(), kMostFiles, kMostBytes));
    files.emplace("/" + name, std::move(file));
  }
  if (const auto index = files.find("/index.html"); index != files.end())
    files.emplace("/", index->second);
  else
    files.clear();
  return files;
}

fs::path page_folder() {
  const fs::path shared = share_folder() / "cockpit_page";
  if (fs::is_directory(shared)) return shared;
  return fs::read_symlink("/proc/self/exe").parent_path() / "cockpit_page";
}

}  // namespace multipanda::cockpit
