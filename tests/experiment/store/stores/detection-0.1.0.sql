BEGIN TRANSACTION;
CREATE TABLE event (
	id INTEGER NOT NULL, 
	session_id INTEGER, 
	at_utc VARCHAR NOT NULL, 
	kind VARCHAR NOT NULL, 
	trials INTEGER, 
	detail VARCHAR NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(session_id) REFERENCES session (id)
);
CREATE TABLE interval (
	id INTEGER NOT NULL, 
	trial_id INTEGER NOT NULL, 
	position INTEGER NOT NULL, 
	stimulus VARCHAR NOT NULL, 
	commanded_db_sl FLOAT, 
	measured_db_sl FLOAT, 
	saturated BOOLEAN NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (trial_id, position), 
	FOREIGN KEY(trial_id) REFERENCES trial (id)
);
INSERT INTO "interval" VALUES(1,1,0,'blank',NULL,5.61115146372917816819e+00,0);
INSERT INTO "interval" VALUES(2,1,1,'tone',30.0,2.98827352300413053845e+01,0);
INSERT INTO "interval" VALUES(3,1,2,'blank',NULL,7.67316473006245,0);
INSERT INTO "interval" VALUES(4,2,0,'blank',NULL,5.74337920150065173174e+00,0);
INSERT INTO "interval" VALUES(5,2,1,'tone',30.0,2.92680372070113534741e+01,0);
INSERT INTO "interval" VALUES(6,2,2,'blank',NULL,6.69967163569080792484e+00,0);
INSERT INTO "interval" VALUES(7,3,0,'blank',NULL,5.83635163979780191567e+00,0);
INSERT INTO "interval" VALUES(8,3,1,'tone',20.0,1.79420841877744798864e+01,0);
INSERT INTO "interval" VALUES(9,3,2,'blank',NULL,5.60039408231503266222e+00,0);
INSERT INTO "interval" VALUES(10,4,0,'blank',NULL,5.37977343075336911226e+00,0);
INSERT INTO "interval" VALUES(11,4,1,'tone',20.0,1.99644900741239652575e+01,0);
INSERT INTO "interval" VALUES(12,4,2,'blank',NULL,5.63724602414938846806e+00,0);
INSERT INTO "interval" VALUES(13,5,0,'blank',NULL,6.40799083531714330774e+00,0);
INSERT INTO "interval" VALUES(14,5,1,'tone',20.0,2.13050127817905092801e+01,0);
INSERT INTO "interval" VALUES(15,5,2,'blank',NULL,4.90258161402479952784e+00,0);
INSERT INTO "interval" VALUES(16,6,0,'blank',NULL,6.20494853904349952244e+00,0);
INSERT INTO "interval" VALUES(17,6,1,'tone',16.0,1.71988101039050391705e+01,0);
INSERT INTO "interval" VALUES(18,6,2,'blank',NULL,6.60014409811013713635e+00,0);
INSERT INTO "interval" VALUES(19,7,0,'tone',18.0,1.96486943052997240499e+01,0);
INSERT INTO "interval" VALUES(20,7,1,'blank',NULL,5.11543585687858826105e+00,0);
INSERT INTO "interval" VALUES(21,7,2,'blank',NULL,5.72620539505629544407e+00,0);
INSERT INTO "interval" VALUES(22,8,0,'tone',18.0,1.87513977350294602786e+01,0);
INSERT INTO "interval" VALUES(23,8,1,'blank',NULL,6.97782860087301148865e+00,0);
INSERT INTO "interval" VALUES(24,8,2,'blank',NULL,6.08173903932129089611e+00,0);
INSERT INTO "interval" VALUES(25,9,0,'blank',NULL,5.49944935196428552615e+00,0);
INSERT INTO "interval" VALUES(26,9,1,'tone',18.0,1.81214948101000388192e+01,0);
INSERT INTO "interval" VALUES(27,9,2,'blank',NULL,5.81041614953103469076e+00,0);
CREATE TABLE response (
	trial_id INTEGER NOT NULL, 
	response VARCHAR NOT NULL, 
	correct BOOLEAN NOT NULL, 
	client_shown_ms FLOAT, 
	client_pressed_ms FLOAT, 
	server_received_utc VARCHAR NOT NULL, 
	PRIMARY KEY (trial_id), 
	FOREIGN KEY(trial_id) REFERENCES trial (id)
);
INSERT INTO "response" VALUES(1,'2',1,10.0,460.0,'2026-03-01T12:00:01.000000+00:00');
INSERT INTO "response" VALUES(2,'2',1,10.0,460.0,'2026-03-01T12:00:02.000000+00:00');
INSERT INTO "response" VALUES(3,'2',1,10.0,460.0,'2026-03-01T12:00:03.000000+00:00');
INSERT INTO "response" VALUES(4,'2',1,10.0,460.0,'2026-03-01T12:00:04.000000+00:00');
INSERT INTO "response" VALUES(5,'2',1,10.0,460.0,'2026-03-01T12:00:05.000000+00:00');
INSERT INTO "response" VALUES(6,'1',0,10.0,460.0,'2026-03-01T12:00:06.000000+00:00');
INSERT INTO "response" VALUES(7,'1',1,10.0,460.0,'2026-03-01T12:00:07.000000+00:00');
INSERT INTO "response" VALUES(8,'1',1,10.0,460.0,'2026-03-01T12:00:08.000000+00:00');
INSERT INTO "response" VALUES(9,'2',1,10.0,460.0,'2026-03-01T12:00:09.000000+00:00');
CREATE TABLE response_option (
	id INTEGER NOT NULL, 
	study_id INTEGER NOT NULL, 
	position INTEGER NOT NULL, 
	label VARCHAR NOT NULL, 
	"key" VARCHAR NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (study_id, label), 
	UNIQUE (study_id, "key"), 
	FOREIGN KEY(study_id) REFERENCES study (id)
);
CREATE TABLE run (
	id INTEGER NOT NULL, 
	session_id INTEGER NOT NULL, 
	position INTEGER NOT NULL, 
	attempt INTEGER NOT NULL, 
	state VARCHAR NOT NULL, 
	practice BOOLEAN NOT NULL, 
	paradigm VARCHAR NOT NULL, 
	procedure VARCHAR NOT NULL, 
	finger VARCHAR NOT NULL, 
	frequency_hz FLOAT, 
	rig VARCHAR NOT NULL, 
	display VARCHAR NOT NULL, 
	controller_sha256 VARCHAR NOT NULL, 
	curve VARCHAR NOT NULL, 
	curve_sha256 VARCHAR NOT NULL, 
	sensor_gain_v_per_mm FLOAT NOT NULL, 
	band_low_hz FLOAT NOT NULL, 
	band_high_hz FLOAT NOT NULL, 
	started_utc VARCHAR NOT NULL, 
	ended_utc VARCHAR, 
	PRIMARY KEY (id), 
	UNIQUE (session_id, position, attempt), 
	CONSTRAINT run_state CHECK (state IN ('running', 'done', 'restarted', 'stopped')), 
	FOREIGN KEY(session_id) REFERENCES session (id)
);
INSERT INTO "run" VALUES(1,1,0,0,'done',1,'forced-choice','fixed','index',50.0,'simulated','three-finger tactuator','96f5e3ea1e1af4124bb3181700ff13d3e3fd0c3cb0ccf064cfe87e04836a2699','bolanowski-1988','2b19809359e23c1b63b52d2e48cf1d548ba417a080baf79496a86a4b19601919',0.19898,0.4,300.0,'2026-03-01T12:00:00.000000+00:00','2026-03-01T12:00:02.000000+00:00');
INSERT INTO "run" VALUES(2,1,1,0,'running',0,'forced-choice','up-down','index',50.0,'simulated','three-finger tactuator','96f5e3ea1e1af4124bb3181700ff13d3e3fd0c3cb0ccf064cfe87e04836a2699','bolanowski-1988','2b19809359e23c1b63b52d2e48cf1d548ba417a080baf79496a86a4b19601919',0.19898,0.4,300.0,'2026-03-01T12:00:02.000000+00:00',NULL);
CREATE TABLE schema_version (
	version INTEGER NOT NULL
);
INSERT INTO "schema_version" VALUES(2);
CREATE TABLE session (
	id INTEGER NOT NULL, 
	study_id INTEGER NOT NULL, 
	subject_number INTEGER NOT NULL, 
	subject_code VARCHAR NOT NULL, 
	subject_group VARCHAR NOT NULL, 
	link_token VARCHAR NOT NULL, 
	experimenter VARCHAR NOT NULL, 
	site VARCHAR NOT NULL, 
	surround VARCHAR NOT NULL, 
	contact_area_mm2 FLOAT, 
	skin_temperature_c FLOAT, 
	preload_n FLOAT, 
	masking_sound VARCHAR NOT NULL, 
	masking_level_db_spl FLOAT, 
	created_utc VARCHAR NOT NULL, 
	consented_utc VARCHAR, 
	PRIMARY KEY (id), 
	UNIQUE (study_id, subject_code), 
	FOREIGN KEY(study_id) REFERENCES study (id), 
	UNIQUE (link_token)
);
INSERT INTO "session" VALUES(1,1,0,'S1','hearing','token-S1','EX','fingertip','none',78.5,31.0,NULL,'pink',NULL,'2026-03-01T12:00:00.000000+00:00','2026-03-01T12:00:00.000000+00:00');
INSERT INTO "session" VALUES(2,1,1,'S2','hearing-impaired','token-S2','EX','fingertip','none',78.5,31.0,NULL,'pink',NULL,'2026-03-01T12:00:00.000000+00:00',NULL);
CREATE TABLE stimulus (
	id INTEGER NOT NULL, 
	study_id INTEGER NOT NULL, 
	label VARCHAR NOT NULL, 
	source VARCHAR NOT NULL, 
	sha256 VARCHAR NOT NULL, 
	duration_s FLOAT NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (study_id, label), 
	FOREIGN KEY(study_id) REFERENCES study (id)
);
CREATE TABLE study (
	id INTEGER NOT NULL, 
	name VARCHAR NOT NULL, 
	protocol_toml VARCHAR NOT NULL, 
	protocol_sha256 VARCHAR NOT NULL, 
	tool_version VARCHAR NOT NULL, 
	created_utc VARCHAR NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (protocol_sha256)
);
INSERT INTO "study" VALUES(1,'short','
[study]
name = "short"
seed = 7
experimenter = "EX"
consent = "You may stop at any time."
[procedure]
kind = "up-down"
start_db_sl = 20
steps_db = [4, 2]
reversals = 6
averaged = 4
[conditions]
fingers = ["index"]
frequencies_hz = [50, 100, 200]
order = "latin-square"
[circumstances]
contact_area_mm2 = 78.5
skin_temperature_c = 31
masking_sound = "pink"
[timing]
stimulus_s = 0.05
ramp_s = 0.01
gap_s = 0.01
lead_s = 0.01
feedback_s = 0.0
[session]
practice_trials = 2
break_after_trials = 20
resume_within_s = 600
[[subject]]
code = "S1"
group = "hearing"
[[subject]]
code = "S2"
group = "hearing-impaired"
','22fbbea6b749ebd7a3dd83e04ac9dd63ff7d7c948a3c9cfe93b9e09119105da5','0.1.0','2026-03-01T12:00:00.000000+00:00');
CREATE TABLE trial (
	id INTEGER NOT NULL, 
	run_id INTEGER NOT NULL, 
	number INTEGER NOT NULL, 
	frequency_hz FLOAT, 
	level_db_sl FLOAT, 
	curve_level_db_re_1um FLOAT, 
	correct_response VARCHAR NOT NULL, 
	presented_utc VARCHAR NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (run_id, number), 
	FOREIGN KEY(run_id) REFERENCES run (id)
);
INSERT INTO "trial" VALUES(1,1,0,50.0,30.0,8.0,'2','2026-03-01T12:00:00.000000+00:00');
INSERT INTO "trial" VALUES(2,1,1,50.0,30.0,8.0,'2','2026-03-01T12:00:01.000000+00:00');
INSERT INTO "trial" VALUES(3,2,0,50.0,20.0,8.0,'2','2026-03-01T12:00:02.000000+00:00');
INSERT INTO "trial" VALUES(4,2,1,50.0,20.0,8.0,'2','2026-03-01T12:00:03.000000+00:00');
INSERT INTO "trial" VALUES(5,2,2,50.0,20.0,8.0,'2','2026-03-01T12:00:04.000000+00:00');
INSERT INTO "trial" VALUES(6,2,3,50.0,16.0,8.0,'2','2026-03-01T12:00:05.000000+00:00');
INSERT INTO "trial" VALUES(7,2,4,50.0,18.0,8.0,'1','2026-03-01T12:00:06.000000+00:00');
INSERT INTO "trial" VALUES(8,2,5,50.0,18.0,8.0,'1','2026-03-01T12:00:07.000000+00:00');
INSERT INTO "trial" VALUES(9,2,6,50.0,18.0,8.0,'2','2026-03-01T12:00:08.000000+00:00');
COMMIT;
