# Messages and services: all files of msg/.
file(GLOB ktgp_orb_messages RELATIVE ${PROJECT_SOURCE_DIR}/msg CONFIGURE_DEPENDS msg/*.msg)
add_message_files(FILES ${ktgp_orb_messages})
add_service_files(FILES DetectTargets.srv MatchPair.srv RemoveTarget.srv SaveMosaic.srv SetPose.srv
  SetTarget.srv)
generate_messages(DEPENDENCIES geometry_msgs sensor_msgs std_msgs)
