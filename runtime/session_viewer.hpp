#pragma once

#include "runtime/session.hpp"

namespace multipanda {

// Displays the sessions of a command in sequence: the cockpit.
class SessionViewer {
 public:
  virtual ~SessionViewer() = default;
  virtual void prepare(SessionOptions& options) = 0;  // sets the options that it needs
  virtual void show(Session& session) = 0;            // before its start
  virtual void end() = 0;                             // before the session is destroyed; idempotent
};

// Shows a session for as long as this exists.
class Viewed {
 public:
  Viewed(SessionViewer* viewer, Session& session) : viewer_(viewer) {
    if (viewer_ != nullptr) viewer_->show(session);
  }
  ~Viewed() {
    if (viewer_ != nullptr) viewer_->end();
  }
  Viewed(const Viewed&) = delete;

 private:
  SessionViewer* viewer_;
};

}  // namespace multipanda
