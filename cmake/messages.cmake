# Messages and services.
add_message_files(FILES
  Correspondences.msg
  HomographyStamped.msg
  Match.msg
  MatchStatistics.msg
  MatchStatus.msg
  StageStatistics.msg
)
add_service_files(FILES MatchPair.srv SaveMosaic.srv SetPose.srv)
generate_messages(DEPENDENCIES geometry_msgs sensor_msgs std_msgs)
