#pragma once

#include <cstdint>
#include <string>

namespace ktgp_orb {

/// "no WHAT on TOPIC", and what keeps it away where that is known.
std::string noneOn(const std::string& what, const std::string& topic, const std::string& trouble);

/// Finds out, once a second, that nothing comes on a topic, and says what may be wrong. It asks the
/// master, which may take long.
class InputWatch {
 public:
  /// Of images; `transport`: image transport.
  InputWatch(std::string topic, std::string transport);
  /// For messages of a type; `what`: its name, for example "homography".
  static InputWatch ofMessages(std::string topic, std::string type, std::string what);

  /// `arrived`: messages since the start; `publishers`: of the topic, where subscribed. A warning
  /// to print, or an empty string: once, and again when what may be wrong changes.
  std::string tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers);

  /// What keeps messages away, as the master knew it at last; empty: nothing, or they come.
  const std::string& trouble() const { return trouble_; }

  /// That several nodes publish the topic, whose images are then mixed, and who; empty: one does.
  std::string mixture(std::uint32_t publishers) const;

 private:
  InputWatch(std::string topic, std::string transport, std::string type, std::string what);

  /// Starts to wait anew.
  void restart();
  /// What the master knows that keeps messages away; empty: nothing.
  std::string askMaster() const;
  /// The topic as the transport has it.
  std::string wanted() const;

  std::string topic_;
  std::string transport_;
  std::string type_;
  std::string what_;
  std::uint64_t arrived_before_ = 0;
  int silent_seconds_ = 0;
  bool subscribed_ = false;
  std::string trouble_;
  bool said_ = false;
};

}  // namespace ktgp_orb
