#pragma once

#include <cstdint>
#include <string>

namespace ktgp_orb {

/// Finds out, once a second, that nothing comes on a topic, and says what may be wrong. It asks the
/// master, which may take long.
class InputWatch {
 public:
  /// Of images; `transport`: image transport.
  InputWatch(std::string topic, std::string transport);
  /// Of messages of a type: `what` it is called, "homography" for example.
  static InputWatch ofMessages(std::string topic, std::string type, std::string what);

  /// `arrived`: messages since the start; `publishers`: of the topic, where subscribed. A warning
  /// to print, or an empty string.
  std::string tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers);

  /// That several nodes publish the topic, whose images are then mixed, and who; empty: one does.
  std::string mixture(std::uint32_t publishers) const;

  /// Starts to wait anew.
  void restart() { silent_seconds_ = 0; }

 private:
  InputWatch(std::string topic, std::string transport, std::string type, std::string what);

  /// What the master knows that keeps messages away; empty: nothing.
  std::string trouble() const;
  /// The topic as the transport has it.
  std::string wanted() const;

  std::string topic_;
  std::string transport_;
  std::string type_;
  std::string what_;
  std::uint64_t arrived_before_ = 0;
  int silent_seconds_ = 0;
};

}  // namespace ktgp_orb
