#pragma once

#include <cstdint>
#include <string>

namespace ktgp_orb {

/// Returns the text "no WHAT on TOPIC", followed by the reason if it is known.
std::string noneOn(const std::string& what, const std::string& topic, const std::string& trouble);

/// Checks once a second whether messages arrive on a topic, and reports likely causes if they do
/// not. Asks the master, so a call may take long.
class InputWatch {
 public:
  /// `type`: type of the messages. `what`: what users call a message, for example "homography".
  /// `transport`: image transport.
  InputWatch(std::string topic, std::string type, std::string what, std::string transport = "raw");

  /// `arrived`: number of messages since the start. `publishers`: number of publishers of the
  /// topic; valid only if `subscribed`. Returns a warning to print, or an empty string. Each cause
  /// is reported once.
  std::string tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers);

  /// The reason why messages are missing, according to the master's last answer; empty if the
  /// reason is unknown or messages arrive.
  const std::string& trouble() const { return trouble_; }

  /// Time without a message while subscribed, s.
  int silentSeconds() const { return subscribed_ ? silent_seconds_ : 0; }

  /// A warning with the names of the nodes if several nodes publish the topic; empty if only one
  /// node does.
  std::string mixture(std::uint32_t publishers) const;

 private:
  /// Restarts the count of silent seconds.
  void restart();
  /// Asks the master why messages are missing. Returns an empty text if the master gives no reason.
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
