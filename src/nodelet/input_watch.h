#pragma once

#include <cstdint>
#include <string>

namespace ktgp_orb {

/// Detects, once a second, that nothing arrives on a topic, and reports likely causes. It asks the
/// master, which may take long.
class InputWatch {
 public:
  /// Of images; `transport`: image transport.
  InputWatch(std::string topic, std::string transport);
  /// For messages of a type; `what`: its name, for example "homography".
  static InputWatch ofMessages(std::string topic, std::string type, std::string what);

  /// `arrived`: messages since the start; `publishers`: of the topic, if subscribed. Returns a
  /// warning to print, or an empty string.
  std::string tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers);

  /// A message that several nodes publish the topic, with their names; empty if only one does.
  std::string mixture(std::uint32_t publishers) const;

  /// Starts to wait again.
  void restart() { silent_seconds_ = 0; }

 private:
  InputWatch(std::string topic, std::string transport, std::string type, std::string what);

  /// What the master knows about the missing messages; empty if nothing.
  std::string trouble() const;
  /// The topic that the transport subscribes to.
  std::string wanted() const;

  std::string topic_;
  std::string transport_;
  std::string type_;
  std::string what_;
  std::uint64_t arrived_before_ = 0;
  int silent_seconds_ = 0;
};

}  // namespace ktgp_orb
