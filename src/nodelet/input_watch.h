#pragma once

#include <cstdint>
#include <string>

namespace ktgp_orb {

/// Finds out, once a second, that no image comes, and says what may be wrong.
class InputWatch {
 public:
  InputWatch(std::string topic, std::string transport)
      : topic_(std::move(topic)), transport_(std::move(transport)) {}

  /// `arrived`: images since the start; `publishers`: of the topic, where subscribed. A warning to
  /// print, or an empty string.
  std::string tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers);

  /// Starts to wait anew.
  void restart() { silent_seconds_ = 0; }

 private:
  /// What the master knows that keeps images away; empty: nothing.
  std::string trouble() const;

  std::string topic_;
  std::string transport_;
  std::uint64_t arrived_before_ = 0;
  int silent_seconds_ = 0;
};

}  // namespace ktgp_orb
