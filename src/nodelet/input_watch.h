#pragma once

#include <cstdint>
#include <string>

namespace ktgp_orb {

/// "no WHAT on TOPIC", and the reason if it is known.
std::string noneOn(const std::string& what, const std::string& topic, const std::string& trouble);

/// Detects, once a second, that nothing arrives on a topic, and reports likely causes. It asks the
/// master, which may take long.
class InputWatch {
 public:
  /// For messages of a type; `what`: its name, for example "homography". `transport`: of images.
  InputWatch(std::string topic, std::string type, std::string what, std::string transport = "raw");

  /// `arrived`: messages since the start; `publishers`: of the topic, if subscribed. Returns a
  /// warning to print, or an empty string. Each cause is reported once.
  std::string tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers);

  /// Why messages are missing, from the last question to the master; empty: unknown, or they
  /// arrive.
  const std::string& trouble() const { return trouble_; }

  /// Time without a message while subscribed, s.
  int silentSeconds() const { return subscribed_ ? silent_seconds_ : 0; }

  /// A message that several nodes publish the topic, with their names; empty if only one does.
  std::string mixture(std::uint32_t publishers) const;

 private:
  /// Restarts the waiting.
  void restart();
  /// Reason for missing messages that the master knows; empty: none.
  std::string askMaster() const;
  /// The topic that the transport subscribes to.
  std::string wanted() const;

  std::string topic_;
  std::string type_;
  std::string what_;
  std::string transport_;
  std::uint64_t arrived_before_ = 0;
  int silent_seconds_ = 0;
  bool subscribed_ = false;
  std::string trouble_;
  bool said_ = false;
};

}  // namespace ktgp_orb
