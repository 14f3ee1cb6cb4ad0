"""Advanced Lane Finding, chapter by chapter: every name that project.ipynb uses.

Each function lives in the module of `lanes` named beside its chapter and is documented there
(`help(helpers.undistort)`); this file only brings them together.

Data             open_dataset, check                                                        lanes.dataset
1 Why            read_image, write_image, list_pictures                                     lanes.images
2 Calibrate      find_board, draw_board, calibrate_folder                                   lanes.boards
                 Camera, Mount, save_camera, load_camera                                    lanes.camera
3 Undistort      undistort                                                                  lanes.camera
4 From above     FourPointWarp, metres_per_pixel, view_to_road                              lanes.view
                 estimate_mount                                                             lanes.mount
5 Thresholds     split_channels, to_gray, range_mask, gradient_x_mask, magnitude_mask,
                 direction_mask, saturation_mask, yellow_mask, equalized_white_mask         lanes.threshold
                 RECIPES, get_recipe, LaneFinder                                            lanes.recipes
6 Find           lane_histogram, find_peaks, sliding_windows, search_band                   lanes.search
7 Fit, measure   fit_line, ransac_line                                                      lanes.fit
                 describe_bend, describe_offset                                             lanes.measure
                 worst_lateral_error_m, paint_share                                         lanes.benchmark
8 Draw, video    draw_line, draw_lane, draw_pixels, draw_fit, write_text                    lanes.draw
                 annotate, diagnose, draw_search, line_points, follow_lane                  lanes.overlay
                 open_clip, annotate_video, read_telemetry                                  lanes.video
Figures          show_pictures, plot_bars, plot_histogram, plot_telemetry                   lanes.plots
"""
