# Messages and services.
add_message_files(FILES
  Correspondences.msg
  HomographyStamped.msg
  Match.msg
  MatchStatistics.msg
  MatchStatus.msg
  StageStatistics.msg
  TargetDetection.msg
  TargetDetections.msg
  TwoViewGeometry.msg
)
add_service_files(FILES DetectTargets.srv MatchPair.srv RemoveTarget.srv SaveMosaic.srv SetPose.srv
  SetTarget.srv)
generate_messages(DEPENDENCIES geometry_msgs sensor_msgs std_msgs)
