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
INSERT INTO "interval" VALUES(1,1,0,'C-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(2,2,0,'MC-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(3,3,0,'M-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(4,4,0,'M-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(5,5,0,'MC-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(6,6,0,'M-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(7,7,0,'M-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(8,8,0,'C-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(9,9,0,'M-index',NULL,NULL,0);
INSERT INTO "interval" VALUES(10,10,0,'C-index',NULL,NULL,0);
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
INSERT INTO "response" VALUES(1,'C-index',1,NULL,NULL,'2026-01-01T00:00:05.000000+00:00');
INSERT INTO "response" VALUES(2,'MC-index',1,NULL,NULL,'2026-01-01T00:00:07.000000+00:00');
INSERT INTO "response" VALUES(3,'M-index',1,NULL,NULL,'2026-01-01T00:00:09.000000+00:00');
INSERT INTO "response" VALUES(4,'M-index',1,NULL,NULL,'2026-01-01T00:00:13.000000+00:00');
INSERT INTO "response" VALUES(5,'MC-index',1,NULL,NULL,'2026-01-01T00:00:15.000000+00:00');
INSERT INTO "response" VALUES(6,'M-index',1,NULL,NULL,'2026-01-01T00:00:17.000000+00:00');
INSERT INTO "response" VALUES(7,'M-index',1,NULL,NULL,'2026-01-01T00:00:19.000000+00:00');
INSERT INTO "response" VALUES(8,'C-index',1,NULL,NULL,'2026-01-01T00:00:21.000000+00:00');
INSERT INTO "response" VALUES(9,'M-index',1,NULL,NULL,'2026-01-01T00:00:23.000000+00:00');
INSERT INTO "response" VALUES(10,'C-index',1,NULL,NULL,'2026-01-01T00:00:25.000000+00:00');
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
INSERT INTO "response_option" VALUES(1,1,0,'M-index','1');
INSERT INTO "response_option" VALUES(2,1,1,'C-index','2');
INSERT INTO "response_option" VALUES(3,1,2,'MC-index','3');
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
INSERT INTO "run" VALUES(1,1,0,0,'done',1,'identification','fixed','all',NULL,'simulated','one finger','d3781c6f13e81d4f22ed4968ce3f641e14941b210a9c868643d47f22424ff05b','bolanowski-1988','2b19809359e23c1b63b52d2e48cf1d548ba417a080baf79496a86a4b19601919',0.19898,0.4,300.0,'2026-01-01T00:00:03.000000+00:00','2026-01-01T00:00:10.000000+00:00');
INSERT INTO "run" VALUES(2,1,1,0,'running',0,'identification','fixed','all',NULL,'simulated','one finger','d3781c6f13e81d4f22ed4968ce3f641e14941b210a9c868643d47f22424ff05b','bolanowski-1988','2b19809359e23c1b63b52d2e48cf1d548ba417a080baf79496a86a4b19601919',0.19898,0.4,300.0,'2026-01-01T00:00:11.000000+00:00',NULL);
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
INSERT INTO "session" VALUES(1,1,0,'S1','unknown','71PmHAIvlKJc9Qataqr1_w','','fingertip','none',NULL,NULL,NULL,'none',NULL,'2026-01-01T00:00:01.000000+00:00',NULL);
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
INSERT INTO "stimulus" VALUES(1,1,'M-index','M-index.wav','b48f16a992328a3944e1abcac600bb16d7bde4638695f01958deb96f21e62b4e',0.125);
INSERT INTO "stimulus" VALUES(2,1,'C-index','C-index.wav','4f27651a99b275146475f53325878cd3f90b90d7ad0609e916db3e6983f84e2a',0.125);
INSERT INTO "stimulus" VALUES(3,1,'MC-index','MC-index.wav','178b0cded9b9531c84c62ca9310de1e9b954ca65e2115a358cb26171153b0e63',0.125);
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
INSERT INTO "study" VALUES(1,'words','[study]
name = "words"
seed = 5
[identification]
paradigm = "identification"
lead_s = 0.0
gap_s = 0.05
[[item]]
label = "M-index"
file = "M-index.wav"
key = "1"
[[item]]
label = "C-index"
file = "C-index.wav"
key = "2"
[[item]]
label = "MC-index"
file = "MC-index.wav"
key = "3"
[[block]]
kind = "training"
repetitions = 1
feedback = true
[[block]]
kind = "test"
repetitions = 10
feedback = false
[[subject]]
code = "S1"
','5660183aa37300d61f489a9f8d8395a367ed58f6dd9bc1bc1e2cc2c868bcc894','0.1.0','2026-01-01T00:00:01.000000+00:00');
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
INSERT INTO "trial" VALUES(1,1,0,NULL,NULL,NULL,'C-index','2026-01-01T00:00:04.000000+00:00');
INSERT INTO "trial" VALUES(2,1,1,NULL,NULL,NULL,'MC-index','2026-01-01T00:00:06.000000+00:00');
INSERT INTO "trial" VALUES(3,1,2,NULL,NULL,NULL,'M-index','2026-01-01T00:00:08.000000+00:00');
INSERT INTO "trial" VALUES(4,2,0,NULL,NULL,NULL,'M-index','2026-01-01T00:00:12.000000+00:00');
INSERT INTO "trial" VALUES(5,2,1,NULL,NULL,NULL,'MC-index','2026-01-01T00:00:14.000000+00:00');
INSERT INTO "trial" VALUES(6,2,2,NULL,NULL,NULL,'M-index','2026-01-01T00:00:16.000000+00:00');
INSERT INTO "trial" VALUES(7,2,3,NULL,NULL,NULL,'M-index','2026-01-01T00:00:18.000000+00:00');
INSERT INTO "trial" VALUES(8,2,4,NULL,NULL,NULL,'C-index','2026-01-01T00:00:20.000000+00:00');
INSERT INTO "trial" VALUES(9,2,5,NULL,NULL,NULL,'M-index','2026-01-01T00:00:22.000000+00:00');
INSERT INTO "trial" VALUES(10,2,6,NULL,NULL,NULL,'C-index','2026-01-01T00:00:24.000000+00:00');
COMMIT;
